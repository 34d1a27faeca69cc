"""Whether the host kept up while somebody decided: how far the vehicle's clock fell behind, how long a picture took.

Paper, "Throughput sensitivity": a step that the host delays is not the model's. Only where the vehicle's clock is held
to the wall's is there such a thing; in lockstep everything waits for everything.
"""

import math
from collections.abc import Callable


class HostPace:
    """What the vehicle's clock is held to, and who wants to know how well that goes. Wall time is the caller's."""

    def __init__(self, wall_s: Callable[[], float], speed: float) -> None:
        """`wall_s` reads the wall's clock, `speed` is the factor on it by which vehicle time shall pass."""
        self._wall_s, self._speed = wall_s, speed
        self._watches: list[HostWatch] = []

    @property
    def now_s(self) -> float:
        """s of wall time × speed, from any zero: what vehicle time is less a constant, if the host is never late."""
        return self._wall_s() * self._speed

    def watch(self) -> "HostWatch":
        """Return a watch for one who decides, which runs from now on."""
        self._watches.append(HostWatch(self))
        return self._watches[-1]

    def tick(self, vehicle_s: float) -> None:
        """Take in the vehicle's time (s) as it is heard now."""
        late_s = self.now_s - vehicle_s
        for watch in self._watches:
            watch.late(late_s)


class HostWatch:
    """How late the host was since it was last asked."""

    def __init__(self, pace: HostPace) -> None:
        self._pace = pace
        self._least_s = self._newest_s = math.inf  # how late it was at best, and when it was last heard
        self._lag_s = 0.0
        self._waited_s = 0.0

    @property
    def now_s(self) -> float:
        """s of wall time × speed, from any zero."""
        return self._pace.now_s

    def late(self, late_s: float) -> None:
        """Take in how late the vehicle's clock is, s less a constant: what counts is by how much that has grown."""
        self._least_s, self._newest_s = min(self._least_s, late_s), late_s
        self._lag_s = max(self._lag_s, late_s - self._least_s)

    def waited(self, seconds: float) -> None:
        """Take in for how long (s of wall time × speed) a picture was waited for."""
        self._waited_s += seconds

    def take(self) -> tuple[float, float]:
        """Return (s by which the vehicle's clock fell behind, s that pictures were waited for) since the last time."""
        told = self._lag_s, self._waited_s
        # from the newest on, so that a stall which begins at this very moment is the next one's
        self._least_s, self._lag_s, self._waited_s = self._newest_s, 0.0, 0.0
        return told
