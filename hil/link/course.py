"""Where a vehicle was and is: the recorded poses, and the arrival at a place."""

import math
from bisect import bisect_left, bisect_right
from collections import deque
from typing import TypeVar

from foundation.frames import Vec3, wrap_pi
from foundation.setpoints import Sight
from hil.link.telemetry import VehicleState

NEAR_M = 0.06
HEADING = math.radians(0.7)
STILL_MPS = 0.12
RESTING_US = 1_000_000  # µs for which it has to be so
COARSE_US = 15_000_000  # µs after which …
COARSER = 3.0  # … so many times as far and as fast is as good as it gets: a GPS that wanders leaves nothing so still


class Arrival:
    """Watches one vehicle on its way to a place and heading."""

    def __init__(self, position_ned: Vec3, yaw: float, due_us: int) -> None:
        """A place (m, local frame) and heading (rad) that cannot have been reached before `due_us` (vehicle clock)."""
        self._position_ned, self._yaw, self._due_us = position_ned, yaw, due_us
        self._resting_us: int | None = None  # since when

    def settled(self, state: VehicleState, time_us: int) -> bool:
        """Return whether it has been there, and still, for a whole second. To be asked at every tick."""
        there = time_us >= self._due_us and self._is_there(state, COARSER if self._is_late(time_us) else 1.0)
        self._resting_us = (self._resting_us or time_us) if there else None
        return self._resting_us is not None and time_us >= self._resting_us + RESTING_US

    def _is_late(self, time_us: int) -> bool:
        return time_us >= self._due_us + COARSE_US

    def _is_there(self, state: VehicleState, times: float) -> bool:
        if state.position_ned is None or state.velocity_ned is None or state.euler is None:
            return False
        return (
            math.dist(state.position_ned, self._position_ned) <= times * NEAR_M
            and math.hypot(*state.velocity_ned) <= times * STILL_MPS
            and abs(wrap_pi(state.euler[2] - self._yaw)) <= times * HEADING
        )


KEPT_US = 375_000_000  # µs; a frame that is acted on is younger: up to a minute late, its reply five more
OVERTAKEN_US = 5_000_000  # µs by which a report may be older than the newest and still be of the same boot
AHEAD_US = 200_000  # µs beyond the newest telemetry for which it is carried on

Report = TypeVar("Report", tuple[int, Vec3, Vec3], tuple[int, float, float], tuple[int, float])


class PoseHistory:
    """Places and headings by the vehicle's clock."""

    def __init__(self) -> None:
        self._places: deque[tuple[int, Vec3, Vec3]] = deque()  # µs, m, m/s
        self._headings: deque[tuple[int, float, float]] = deque()  # µs, rad, rad/s
        self._tilts: deque[tuple[int, float, float]] = deque()  # µs, rad roll, rad pitch
        self._ranges: deque[tuple[int, float]] = deque()  # µs, m

    def place(self, time_us: int, position_ned: Vec3, velocity_ned: Vec3) -> None:
        """Record a place (m, local frame) and velocity (m/s)."""
        _keep(self._places, (time_us, position_ned, velocity_ned))

    def heading(self, time_us: int, yaw: float, yaw_rate: float) -> None:
        """Record a heading (rad) and its rate (rad/s)."""
        _keep(self._headings, (time_us, yaw, yaw_rate))

    def tilt(self, time_us: int, roll: float, pitch: float) -> None:
        """Record roll and pitch (rad)."""
        _keep(self._tilts, (time_us, roll, pitch))

    def range(self, time_us: int, range_m: float) -> None:
        """Record a range of the rangefinder (m)."""
        _keep(self._ranges, (time_us, range_m))

    def at(self, time_us: int) -> Sight | None:
        """Return where the vehicle was at a time (µs), None while nothing is known.

        Between two reports it is interpolated, after the newest carried on for a moment, and before the oldest that.
        """
        if not self._places or not self._headings:
            return None
        before, after, share, ahead_s = _around(self._places, time_us)
        place = tuple(b + share * (a - b) + ahead_s * v for b, a, v in zip(before[1], after[1], after[2], strict=True))
        first, second, part, on_s = _around(self._headings, time_us)
        heading = first[1] + part * wrap_pi(second[1] - first[1]) + on_s * second[2]
        roll, pitch = self._tilt(time_us)
        carried_on = time_us > min(self._places[-1][0], self._headings[-1][0])
        return Sight((place[0], place[1], place[2]), wrap_pi(heading), roll, pitch, carried_on)

    def _tilt(self, time_us: int) -> tuple[float, float]:
        """Return roll and pitch (rad) at a time, level while nothing is known; never carried on."""
        if not self._tilts:
            return 0.0, 0.0
        before, after, share, _ = _around(self._tilts, time_us)
        return before[1] + share * (after[1] - before[1]), before[2] + share * (after[2] - before[2])

    def mean_place(self, seconds: float) -> Vec3 | None:
        """Return the mean place (m, local frame) over the last `seconds`, None while nothing is known."""
        late = [place for _, place, _ in self._late(self._places, seconds)]
        if not late:
            return None
        north, east, down = (sum(values) / len(late) for values in zip(*late, strict=True))
        return (north, east, down)

    def mean_range(self, seconds: float) -> float | None:
        """Return the mean of the rangefinder (m) over the last `seconds`, None where there is none that is heard."""
        late = [range_m for _, range_m in self._late(self._ranges, seconds)]
        return sum(late) / len(late) if late else None

    def _late(self, reports: deque[Report], seconds: float) -> list[Report]:
        since_us = self._places[-1][0] - round(seconds * 1e6) if self._places else 0
        return [report for report in reports if report[0] >= since_us]


def _keep(reports: deque[Report], report: Report) -> None:
    """Put a report into its place and drop what is too old; an older clock begins a new track."""
    if reports and report[0] < reports[-1][0] - OVERTAKEN_US:
        reports.clear()
    if reports and report[0] < reports[-1][0]:  # others have overtaken it
        k = bisect_left(reports, report[0], key=lambda entry: entry[0])
        if reports[k][0] == report[0]:
            reports[k] = report
        else:
            reports.insert(k, report)
        return
    if reports and report[0] == reports[-1][0]:
        reports.pop()
    reports.append(report)
    while reports[0][0] < report[0] - KEPT_US:
        reports.popleft()


def _around(reports: deque[Report], time_us: int) -> tuple[Report, Report, float, float]:
    """Return the reports before and after a time, how far between them it is (0 … 1), and how far beyond (s)."""
    k = bisect_right(reports, time_us, key=lambda report: report[0])
    if k == 0:
        return reports[0], reports[0], 0.0, 0.0
    if k == len(reports):
        return reports[-1], reports[-1], 0.0, min(time_us - reports[-1][0], AHEAD_US) / 1e6
    before, after = reports[k - 1], reports[k]
    return before, after, (time_us - before[0]) / (after[0] - before[0]), 0.0
