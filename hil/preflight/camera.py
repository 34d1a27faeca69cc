"""The camera: does it give frames, how many a second, and how old are they."""

import statistics
import time
from collections.abc import Callable

from foundation.camera import Camera, Frame
from foundation.errors import CameraError
from hil.preflight.row import Row

NAME = "camera"
RATE_LEAST = 1.0  # Hz: a decision takes seconds, but the frame it is made from must not
AGE_MOST = 1.0  # s


def row(url: str, now_us: Callable[[], int], keep_up: Callable[[], None], seconds: float) -> Row:
    """Return the row of a camera that was looked through for `seconds` of wall time; `keep_up` serves the link."""
    from hil.cameras.open import open_camera

    frames: list[Frame] = []
    fetch_s: list[float] = []
    age_s: list[float] = []
    try:
        camera: Camera = open_camera(url, now_us)
        try:
            camera.newest()  # the first one also opens the connection
            began_s = time.monotonic()  # wall time is the subject here
            while time.monotonic() - began_s < seconds:
                asked_s = time.monotonic()
                frame = camera.newest()
                fetch_s.append(time.monotonic() - asked_s)
                if not frames or frame.frame_id != frames[-1].frame_id:
                    age_s.append((now_us() - frame.time_us) * 1e-6)
                    frames.append(frame)
                keep_up()
            took_s = time.monotonic() - began_s
        finally:
            camera.close()
    except CameraError as error:
        return Row(NAME, False, str(error), "look at it with a browser or a player first")
    height, width = frames[-1].image_rgb.shape[:2]
    rate, age, fetch = len(frames) / took_s, statistics.median(age_s), statistics.median(fetch_s)
    why = f"{width}×{height}, {rate:.1f} new frames a second, fetched in {1e3 * fetch:.0f} ms"
    why += f", {1e3 * age:.0f} ms old when here" if age > 1e-3 else ", stamped on arrival"
    if rate < RATE_LEAST or not -AGE_MOST <= age <= AGE_MOST:
        return Row(NAME, False, f"{why}: too old or too rare to decide by", "a smaller picture, or a nearer camera")
    return Row(NAME, True, why)
