"""Holds a simulation to the wall clock and says how well that went. Here wall time is the subject."""

import time

RESYNC_S = 0.5  # further behind than this the lost time is given up rather than caught up in a burst


class RateKeeper:
    """Waits until the next tick is due."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.ticks = 0
        self.late = 0  # ticks that began more than 2 ms after they were due
        self.lag_max_s = 0.0
        self._due_s = time.monotonic()

    def wait(self) -> None:
        """Return when the next tick is due; count it if it is late already."""
        self._due_s += self.period_s
        remaining_s = self._due_s - time.monotonic()
        if remaining_s > 0:
            time.sleep(remaining_s)
        lag_s = time.monotonic() - self._due_s
        self.ticks += 1
        self.lag_max_s = max(self.lag_max_s, lag_s)
        if lag_s > 0.002:
            self.late += 1
        if lag_s > RESYNC_S:
            self._due_s = time.monotonic()
