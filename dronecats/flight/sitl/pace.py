"""Synchronises a simulation with the wall clock, reports the lag, and stalls the simulation on purpose."""

import random
import time
from collections.abc import Callable

from dronecats.flight.spec.disturbances import VehicleFaults

LATE_S = 0.002  # s; a tick that begins more than this after it was due counts as late
LATE_SHARE = 0.001  # share of late ticks above which the lag is reported
REPORT_S = 60.0  # wall s between two reports
RESYNC_S = 0.5  # s; a larger lag is skipped, so that the simulation does not catch up in a burst
# The scheduler ends a sleep late, mostly by less than 0.1 ms. So the sleep is this much shorter, and a loop that yields
# the processor waits for the remaining time.
EARLY_S = 0.0003


class RateKeeper:
    """Waits until the next tick is due."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.restart()

    def restart(self) -> None:
        """Reset all counts, and start from now."""
        self.ticks = 0
        self.late = 0  # number of late ticks
        self.skipped_s = 0.0  # sum of the skipped lags, by which the simulation stays behind the wall clock
        self.lag_s = 0.0  # lag of the newest tick
        self.lag_max_s = 0.0
        self._due_s = time.monotonic()

    @property
    def late_share(self) -> float:
        return self.late / self.ticks if self.ticks else 0.0

    def figures(self) -> dict[str, float]:
        """Return the counts and lags since the last restart, rounded."""
        return {
            "ticks": self.ticks,
            "late": self.late,
            "late_share": round(self.late_share, 6),
            "lag_max_s": round(self.lag_max_s, 6),
            "skipped_s": round(self.skipped_s, 3),
        }

    def wait(self) -> None:
        """Wait until the next tick is due, and record its lag."""
        self._due_s += self.period_s
        remaining_s = self._due_s - time.monotonic()
        if remaining_s > EARLY_S:
            time.sleep(remaining_s - EARLY_S)
        while time.monotonic() < self._due_s:
            time.sleep(0)
        self.lag_s = time.monotonic() - self._due_s
        self.ticks += 1
        self.lag_max_s = max(self.lag_max_s, self.lag_s)
        if self.lag_s > LATE_S:
            self.late += 1
        if self.lag_s > RESYNC_S:
            self.skipped_s += self.lag_s
            self._due_s = time.monotonic()


class PaceReport:
    """Reports the lag of a simulation behind the wall clock, once a minute at most."""

    def __init__(self, keeper: RateKeeper) -> None:
        self._keeper = keeper
        self._ticks = self._late = 0
        self._skipped_s = 0.0
        self._due_s = time.monotonic() + REPORT_S

    def line(self) -> str | None:
        """Return a sentence if more than LATE_SHARE of the last minute's ticks were late; otherwise None."""
        if time.monotonic() < self._due_s:
            return None
        self._due_s += REPORT_S
        keeper = self._keeper
        ticks, late = keeper.ticks - self._ticks, keeper.late - self._late
        skipped_s = keeper.skipped_s - self._skipped_s
        self._ticks, self._late, self._skipped_s = keeper.ticks, keeper.late, keeper.skipped_s
        if late <= LATE_SHARE * ticks:
            return None
        lost = f", {skipped_s:.1f} s skipped" if skipped_s else ""
        return (
            f"the simulator is slower than real time: {100 * late / ticks:.1f} % of the last minute's ticks"
            " were more than "
            f"{1e3 * LATE_S:.0f} ms late (worst since the start {1e3 * keeper.lag_max_s:.0f} ms{lost})"
        )


class Staller:
    """Simulates a busy computer: blocks its caller at the start of randomly drawn seconds of vehicle time."""

    def __init__(
        self, disturbances: VehicleFaults | None, seed: int, stop: Callable[[float], None] = time.sleep
    ) -> None:
        """`stop` blocks for a number of wall seconds."""
        self._stalls, self._stop = disturbances or VehicleFaults(), stop
        self._fate = random.Random(f"{seed} host")
        self._due_us: int | None = None
        self.count = 0

    def begin(self, time_us: int) -> None:
        """Start the stalls at this vehicle time (µs)."""
        self._due_us = time_us

    def turn(self, time_us: int) -> None:
        """Block if a second of vehicle time with a stall begins; otherwise return at once."""
        if not (self._stalls.stalled and self._stalls.stall_s) or self._due_us is None or time_us < self._due_us:
            return
        self._due_us += 1_000_000
        if self._fate.random() < self._stalls.stalled:
            self.count += 1
            self._stop(self._stalls.stall_s)
