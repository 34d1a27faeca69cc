"""Records the poses of a vehicle, and detects its arrival at a place."""

import math
from array import array
from bisect import bisect_left, bisect_right

from foundation.frames import Vec3, wrap_pi
from foundation.setpoints import PicturePose
from hil.link.telemetry import VehicleState

# limits of an arrival: distance, heading error (rad), speed
NEAR_M = 0.06
HEADING = math.radians(0.7)
STILL_MPS = 0.12
RESTING_US = 1_000_000  # µs for which the vehicle must stay within these limits
COARSE_US = 15_000_000  # µs after `due_us` until the limits are widened
COARSER = 3.0  # factor that widens the limits: with a drifting GPS no vehicle would meet the first ones


class Arrival:
    """Watches one vehicle on its way to a place and heading."""

    def __init__(self, position_ned: Vec3, yaw: float, due_us: int) -> None:
        """Watch for the arrival at a place (m, local frame) and heading (rad), from `due_us` (µs, vehicle clock) on."""
        self._position_ned, self._yaw, self._due_us = position_ned, yaw, due_us
        self._resting_us: int | None = None  # when the vehicle came to rest at the place; None: not yet

    def settled(self, state: VehicleState, time_us: int) -> bool:
        """Return whether the vehicle has stayed at the place and heading for RESTING_US. Call this at every tick."""
        is_late = time_us >= self._due_us + COARSE_US
        there = time_us >= self._due_us and self._is_there(state, COARSER if is_late else 1.0)
        self._resting_us = (self._resting_us or time_us) if there else None
        return self._resting_us is not None and time_us >= self._resting_us + RESTING_US

    def _is_there(self, state: VehicleState, times: float) -> bool:
        if state.position_ned is None or state.velocity_ned is None or state.euler is None:
            return False
        return (
            math.dist(state.position_ned, self._position_ned) <= times * NEAR_M
            and math.hypot(*state.velocity_ned) <= times * STILL_MPS
            and abs(wrap_pi(state.euler[2] - self._yaw)) <= times * HEADING
        )


KEPT_US = 375_000_000  # µs; longer than a frame is in use: up to 1 min of delay and 5 min until the reply
OVERTAKEN_US = 5_000_000  # µs; if a report is older than the newest by more than this, the vehicle has rebooted
AHEAD_US = 200_000  # µs; a pose is extrapolated at most this far beyond the newest telemetry
DROPPED_AT_ONCE = 512  # number of old reports whose memory is freed together


class PoseHistory:
    """The history of places, attitudes and ranges, by the vehicle's clock."""

    def __init__(self) -> None:
        self._places = _Reports(6)  # m north, east, down; m/s north, east, down
        self._headings = _Reports(2)  # rad, rad/s
        self._tilts = _Reports(2)  # rad roll, rad pitch
        self._gimbals = _Reports(1)  # rad
        self._ranges = _Reports(1)  # m

    def place(self, time_us: int, position_ned: Vec3, velocity_ned: Vec3) -> None:
        """Record a place (m, local frame) and velocity (m/s)."""
        self._places.keep(time_us, (*position_ned, *velocity_ned))

    def heading(self, time_us: int, yaw: float, yaw_rate: float) -> None:
        """Record a heading (rad) and its rate (rad/s)."""
        self._headings.keep(time_us, (yaw, yaw_rate))

    def tilt(self, time_us: int, roll: float, pitch: float) -> None:
        """Record roll and pitch (rad)."""
        self._tilts.keep(time_us, (roll, pitch))

    def gimbal(self, time_us: int, pitch: float) -> None:
        """Record the pitch (rad, up from the horizon) of the camera's gimbal."""
        self._gimbals.keep(time_us, (pitch,))

    def range(self, time_us: int, range_m: float) -> None:
        """Record a range of the rangefinder (m)."""
        self._ranges.keep(time_us, (range_m,))

    def at(self, time_us: int) -> PicturePose | None:
        """Return the vehicle's pose at a time (µs); None if there is no report yet.

        The pose is interpolated between two reports, and extrapolated by at most AHEAD_US after the newest report.
        Before the oldest report, it is the oldest pose.
        """
        if not self._places or not self._headings:
            return None
        before, after, share, ahead_s = self._places.around(time_us)
        north, east, down = (
            b + share * (a - b) + ahead_s * v for b, a, v in zip(before[:3], after[:3], after[3:], strict=True)
        )
        first, second, part, on_s = self._headings.around(time_us)
        heading = first[0] + part * wrap_pi(second[0] - first[0]) + on_s * second[1]
        roll, pitch = self._tilts.between(time_us) if self._tilts else (0.0, 0.0)
        gimbal_pitch = self._gimbals.between(time_us)[0] if self._gimbals else None
        carried_on = time_us > min(self._places.newest_us, self._headings.newest_us)
        return PicturePose((north, east, down), wrap_pi(heading), roll, pitch, gimbal_pitch, carried_on)

    def mean_place(self, seconds: float) -> Vec3 | None:
        """Return the mean place (m, local frame) over the last `seconds`; None before the first report."""
        late = self._late(self._places, seconds)
        if not late:
            return None
        north, east, down = (sum(values) / len(late) for values in list(zip(*late, strict=True))[:3])
        return (north, east, down)

    def mean_range(self, seconds: float) -> float | None:
        """Return the mean of the rangefinder (m) over the last `seconds`; None if it sent no range in this time."""
        late = self._late(self._ranges, seconds)
        return sum(range_m for (range_m,) in late) / len(late) if late else None

    def _late(self, reports: "_Reports", seconds: float) -> list[tuple[float, ...]]:
        return reports.since(self._places.newest_us - round(seconds * 1e6) if self._places else 0)


class _Reports:
    """Reports with `width` numbers each, sorted by time (µs).

    The numbers are in flat arrays. With one object per report the heap would fragment and grow for hours, because
    reports are kept for minutes, but most other objects only for milliseconds.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._times = array("q")
        self._values = array("d")
        self._first = 0  # index of the first report that is not too old

    def __bool__(self) -> bool:
        return len(self._times) > 0  # the newest report is never too old

    @property
    def newest_us(self) -> int:
        return self._times[-1]

    def keep(self, time_us: int, report: tuple[float, ...]) -> None:
        """Insert a report by its time, and drop old reports. A much older time (a reboot) starts a new history."""
        times = self._times
        if times and time_us < times[-1] - OVERTAKEN_US:
            del times[:], self._values[:]
            self._first = 0
        k = bisect_left(times, time_us, self._first) if times and time_us <= times[-1] else len(times)
        if k < len(times) and times[k] == time_us:
            self._values[k * self._width : (k + 1) * self._width] = array("d", report)
        elif k == len(times):
            times.append(time_us)
            self._values.extend(report)
        else:  # the report arrived after newer ones
            times.insert(k, time_us)
            self._values[k * self._width : k * self._width] = array("d", report)
        self._drop()

    def _drop(self) -> None:
        while self._times[self._first] < self._times[-1] - KEPT_US:
            self._first += 1
        if self._first >= DROPPED_AT_ONCE:
            del self._times[: self._first], self._values[: self._first * self._width]
            self._first = 0

    def since(self, time_us: int) -> list[tuple[float, ...]]:
        """Return the reports from a time on."""
        return [self._report(k) for k in range(bisect_left(self._times, time_us, self._first), len(self._times))]

    def around(self, time_us: int) -> tuple[tuple[float, ...], tuple[float, ...], float, float]:
        """Return (report before, report after, share of the time between them 0 … 1, s after the newest report)."""
        times = self._times
        k = bisect_right(times, time_us, self._first)
        if k == self._first:
            return self._report(k), self._report(k), 0.0, 0.0
        before = self._report(k - 1)
        if k == len(times):
            return before, before, 0.0, min(time_us - times[-1], AHEAD_US) / 1e6
        return before, self._report(k), (time_us - times[k - 1]) / (times[k] - times[k - 1]), 0.0

    def between(self, time_us: int) -> tuple[float, ...]:
        """Return the numbers at a time: interpolated, but not extrapolated."""
        before, after, share, _ = self.around(time_us)
        return tuple(b + share * (a - b) for b, a in zip(before, after, strict=True))

    def _report(self, k: int) -> tuple[float, ...]:
        return tuple(self._values[k * self._width : (k + 1) * self._width])
