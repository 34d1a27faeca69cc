"""Rows of the preflight check about the link, the camera and the disk.

Link: rates of telemetry, round trip, both clocks. Camera: rate and age of its frames.
"""

import os
import shutil
import statistics
import time
from collections.abc import Callable
from pathlib import Path

from foundation.camera import Camera, Frame
from foundation.errors import CameraError
from foundation.mavlink import dialect
from foundation.sensors import CALENDAR_START_US
from hil.preflight.observation import STREAM_HZ, Observation, Row, RuleResult, bad, good, unclear

FLIGHT_STREAMS = (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE)
RATE_LEAST = 8.0  # Hz; at a lower rate, our control of height and position lags too much
SHARE_LEAST = 0.8  # share of the requested rate; a lower rate is reported
ROUND_TRIP_MOST = 0.5  # s; one way then takes half of COM_OF_LOSS_T (0.5 s without setpoints end Offboard)
LOST_MOST = 0.35  # share of unanswered requests; reached if about one message in five is lost in each direction
DRIFT_MOST = 2e-3  # s per s; a quartz clock drifts 1e-4, so a larger drift shows a simulated or overloaded vehicle
CALENDAR_MOST = 2.0  # s, largest accepted difference between the vehicle's date and this machine's
SIMULATED_MOST_US = 7 * 86_400_000_000  # µs after CALENDAR_START_US: a simulator seldom runs longer than a week


def wire_rows(observed: Observation) -> list[Row]:
    """Return the rows of rates, round trip and clocks."""
    return [
        _rates(observed).named("telemetry rates"),
        _round_trip(observed).named("round trip"),
        _clock(observed).named("clocks"),
    ]


def _rates(observed: Observation) -> RuleResult:
    if observed.seconds <= 0.0:
        return unclear("not measured")
    rates = {i: observed.counts.get(i, 0) / observed.seconds for i in STREAM_HZ}
    names = {i: dialect.mavlink_map[i].msgname for i in STREAM_HZ}
    rates_text = {i: f"{names[i]} {rates[i]:.1f} of {STREAM_HZ[i]:g} Hz" for i in STREAM_HZ}
    slow = [rates_text[i] for i in STREAM_HZ if rates[i] < SHARE_LEAST * STREAM_HZ[i]]
    flight_rates = ", ".join(rates_text[i] for i in FLIGHT_STREAMS)
    if min(rates[i] for i in FLIGHT_STREAMS) < RATE_LEAST:
        return bad(f"{', '.join(slow)}: too slow to hold a position", "a faster wire, or a higher MAV_x_RATE")
    if slow:
        return unclear(
            f"{flight_rates}; slower than requested: {', '.join(slow)}", "a faster wire, or a higher MAV_x_RATE"
        )
    return good(f"{flight_rates}, and all other requested rates")


def _round_trip(observed: Observation) -> RuleResult:
    if not observed.sync_requests:
        return unclear("not measured")
    if not observed.round_trips:
        return unclear(f"none of {observed.sync_requests} TIMESYNC requests was answered")
    lengths = sorted(trip.length_s for trip in observed.round_trips)
    lost = 1.0 - len(lengths) / observed.sync_requests
    why = f"{1e3 * statistics.median(lengths):.1f} ms, at worst {1e3 * lengths[-1]:.0f} ms"
    why += f", {100 * lost:.0f} % of {observed.sync_requests} requests not answered" if lost > 0.0 else ""
    if statistics.median(lengths) > ROUND_TRIP_MOST or lost > LOST_MOST:
        return bad(f"{why}: setpoints would arrive too late or not at all", "use a better connection")
    return good(why)


def _clock(observed: Observation) -> RuleResult:
    if len(observed.round_trips) < 2:
        return unclear("the vehicle's clock was not compared with this machine's")
    first, last = _best(observed, early=True), _best(observed, early=False)
    span_ns = last[0] - first[0]
    drift = (last[1] - first[1]) / span_ns if span_ns > 0 else 0.0
    why = f"the vehicle's clock gains {1e6 * drift:+.0f} µs a second on this machine's"
    calendar = observed.message("SYSTEM_TIME")
    if is_simulated(observed):
        why += "; its date is simulated"
    elif calendar is not None and calendar.time_unix_usec:
        apart = observed.unix_s - calendar.time_unix_usec * 1e-6
        why += f"; its date is {abs(apart):.1f} s {'behind' if apart > 0 else 'ahead'}"
        if abs(apart) > CALENDAR_MOST:
            return unclear(why, "set this machine's clock (NTP), because logs are matched by it")
    slack = max(DRIFT_MOST, 2.0 * (first[2] + last[2]) / max(span_ns, 1))  # the round trips limit the accuracy
    if abs(drift) > slack:
        return unclear(why, "either the simulation does not run in real time, or the autopilot is overloaded")
    return good(why)


def is_simulated(observed: Observation) -> bool:
    """Return whether the date is from our simulated GPS receiver, whose date at boot is always the same."""
    calendar = observed.message("SYSTEM_TIME")
    return calendar is not None and 0 <= calendar.time_unix_usec - CALENDAR_START_US < SIMULATED_MOST_US


def _best(observed: Observation, *, early: bool) -> tuple[int, int, int]:
    """Return (time, clock offset, half the duration) in ns of the fastest round trip in the early or late half."""
    half = len(observed.round_trips) // 2
    trips = observed.round_trips[:half] if early else observed.round_trips[half:]
    trip = min(trips, key=lambda t: t.length_s)
    return trip.sent_ns, trip.offset_ns, round(trip.length_s * 0.5e9)


CAMERA = "camera"
FRAME_RATE_LEAST = 1.0  # Hz; a decision takes seconds, but it needs a recent frame
FRAME_AGE_MOST = 1.0  # s


def camera_row(url: str, now_us: Callable[[], int], keep_up: Callable[[], None], seconds: float) -> Row:
    """Return the row of a camera, measured for `seconds` of wall time; `keep_up` serves the link meanwhile."""
    from hil.cameras.open import open_camera

    newest: Frame | None = None
    fetch_s: list[float] = []
    age_s: list[float] = []
    try:
        camera: Camera = open_camera(url, now_us)
        try:
            camera.newest()  # not measured: the first frame also opens the connection
            began_s = time.monotonic()
            while time.monotonic() - began_s < seconds:
                began_fetch_s = time.monotonic()
                frame = camera.newest()
                fetch_s.append(time.monotonic() - began_fetch_s)
                if newest is None or frame.frame_id != newest.frame_id:
                    age_s.append((now_us() - frame.time_us) * 1e-6)
                    newest = frame  # only the newest, because all images of ten minutes do not fit into memory
                keep_up()
            took_s = time.monotonic() - began_s
        finally:
            camera.close()
    except CameraError as error:
        return Row(CAMERA, False, str(error), "check it with: dronecats camera check URL")
    assert newest is not None
    height, width = newest.image_rgb.shape[:2]
    rate, age, fetch = len(age_s) / took_s, statistics.median(age_s), statistics.median(fetch_s)
    why = f"{width}×{height}, {rate:.1f} new frames a second, fetched in {1e3 * fetch:.0f} ms"
    why += f", {1e3 * age:.0f} ms old when here" if age > 1e-3 else ", stamped on arrival"
    if rate < FRAME_RATE_LEAST or not -FRAME_AGE_MOST <= age <= FRAME_AGE_MOST:
        return Row(
            CAMERA,
            False,
            f"{why}: too old or too rare for decisions",
            "use a smaller picture, or a faster connection to the camera",
        )
    return Row(CAMERA, True, why)


DISK = "disk"
DISK_LEAST_GB = 1.0  # an episode keeps about 120 frames of 40 kB and 30 MB of telemetry; a full disk ends its logs


def disk_row(folder: Path) -> Row:
    """Return the row of the disk of `folder`, which may not exist yet."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        return Row(DISK, False, f"{folder} cannot be written to", "name another folder with --out")
    free_gb = shutil.disk_usage(there).free / 1e9
    if free_gb < DISK_LEAST_GB:
        return Row(DISK, False, f"{free_gb:.2f} GB free for {folder}", f"make room for {DISK_LEAST_GB:g} GB")
    return Row(DISK, True, f"{free_gb:.0f} GB free for {folder}")
