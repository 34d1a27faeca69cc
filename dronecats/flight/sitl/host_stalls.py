"""A host that holds the simulator up now and then, on purpose. Here wall time is the subject."""

import random
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class HostStalls:
    """How often, and for how long."""

    share: float = 0.0  # of the vehicle's seconds, each of which may begin with one
    seconds: float = 0.5  # s of wall time

    def __bool__(self) -> bool:
        return self.share > 0.0 and self.seconds > 0.0


NO_STALLS = HostStalls()


class Staller:
    """Stops whoever calls it, from `begin` on: which seconds those are is the seed's."""

    def __init__(self, stalls: HostStalls, seed: int, stop: Callable[[float], None] = time.sleep) -> None:
        """`stop` lets the wall seconds pass that it is given."""
        self._stalls, self._stop = stalls, stop
        self._fate = random.Random(f"{seed} host")
        self._due_us: int | None = None
        self.count = 0

    def begin(self, time_us: int) -> None:
        """From this vehicle time (µs) on there are stalls."""
        self._due_us = time_us

    def turn(self, time_us: int) -> None:
        """Return at once, or after a stall when a second of vehicle time begins that has one."""
        if not self._stalls or self._due_us is None or time_us < self._due_us:
            return
        self._due_us += 1_000_000
        if self._fate.random() < self._stalls.share:
            self.count += 1
            self._stop(self._stalls.seconds)
