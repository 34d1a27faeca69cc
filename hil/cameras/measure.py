"""Measures a camera: the rate and the jitter of its frames, and their age when they can be used."""

import statistics
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from foundation.camera import CameraModel, Frame
from hil.cameras.http import HttpCamera
from hil.cameras.open import RealCamera
from hil.cameras.stream import StreamEndedError

GAP = 1.6  # factor on the usual interval between two frames; a longer interval means that a picture is missing


@dataclass(frozen=True, slots=True)
class CameraMeasurement:
    """Results of a measurement. Intervals are between time stamps. Ages are measured after the lens correction."""

    model: CameraModel  # of the measured frames
    calibrated: bool  # whether the field of view comes from a calibration
    asked: bool  # whether each frame needs a request; the requests then limit the rate
    frames: int
    seconds: float  # s, host's clock, from the first frame to the last
    rate_hz: float | None  # Hz, of all arriving pictures; None: fewer than two frames
    interval_ms: float | None  # median interval of consecutive frames; None: no two frames are consecutive
    jitter_ms: float | None  # standard deviation of the intervals; None as for `interval_ms`
    longest_ms: float | None  # longest interval; None as for `interval_ms`
    age_ms: float | None  # median age; None: the camera stamps by its own clock
    oldest_ms: float | None  # highest age; None as for `age_ms`
    missing: int  # number of missing pictures, computed from the gaps
    repeated: int  # pictures that are equal to the previous one, bit for bit
    unseen: int  # pictures that arrived while this computer was busy with an earlier one
    reopened: int  # number of times that the stream broke and was reopened


def measure(camera: RealCamera, seconds: float) -> tuple[CameraMeasurement, Frame]:
    """Measure the frames of a camera for `seconds`; return the results and the last frame.

    The camera must use the clock `host_us`. Raises CameraError if no more frames arrive.
    """
    frame = camera.newest()
    model, polled = camera.model, isinstance(camera, HttpCamera)
    own_clock = isinstance(camera, HttpCamera) and camera.stamps
    began_s, numbers, stamps_us, ages_ms, repeated = time.monotonic(), [], [], [], 0
    while True:
        numbers.append(frame.frame_id)
        stamps_us.append(frame.time_us)
        ages_ms.append((host_us() - frame.time_us) / 1e3)
        if time.monotonic() - began_s >= seconds:
            break
        try:
            following = camera.following(frame.frame_id)
        except StreamEndedError:  # the recording is shorter than `seconds`
            break
        repeated += bool(np.array_equal(following.image_rgb, frame.image_rgb))
        frame = following
    spans = [
        (later_us - us) / 1e3
        for (number, us), (later, later_us) in pairwise(zip(numbers, stamps_us, strict=True))
        if later == number + 1
    ]
    usual = statistics.median(spans) if spans else None
    took_s = time.monotonic() - began_s
    came, span_s = numbers[-1] - numbers[0], (stamps_us[-1] - stamps_us[0]) / 1e6
    if polled:  # the frame numbers of a camera that needs requests have no meaning
        came, span_s = len(numbers) - 1, took_s
    return CameraMeasurement(
        model=model,
        calibrated=camera.calibrated,
        asked=polled,
        frames=len(numbers),
        seconds=took_s,
        rate_hz=came / span_s if came > 0 and span_s > 0 else None,
        interval_ms=usual,
        jitter_ms=statistics.pstdev(spans) if spans else None,
        longest_ms=max(spans, default=None),
        age_ms=None if own_clock else statistics.median(ages_ms),
        oldest_ms=None if own_clock else max(ages_ms),
        missing=sum(round(span / usual) - 1 for span in spans if span > GAP * usual) if usual else 0,
        repeated=repeated,
        unseen=0 if polled else came - len(numbers) + 1,
        reopened=camera.reopened,
    ), frame


def host_us() -> int:
    """Return the host's monotonic clock in µs, which replaces the vehicle's clock if there is no vehicle."""
    return time.monotonic_ns() // 1000
