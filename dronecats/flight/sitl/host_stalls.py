"""A host that holds the simulator up now and then, on purpose. Here wall time is the subject."""

import random
import time
from collections.abc import Callable

from dronecats.flight.disturbances import VehicleFaults


class Staller:
    """Stops whoever calls it, from `begin` on: which seconds those are is the seed's."""

    def __init__(
        self, disturbances: VehicleFaults | None, seed: int, stop: Callable[[float], None] = time.sleep
    ) -> None:
        """`stop` lets the wall seconds pass that it is given."""
        self._stalls, self._stop = disturbances or VehicleFaults(), stop
        self._fate = random.Random(f"{seed} host")
        self._due_us: int | None = None
        self.count = 0

    def begin(self, time_us: int) -> None:
        """From this vehicle time (µs) on there are stalls."""
        self._due_us = time_us

    def turn(self, time_us: int) -> None:
        """Return at once, or after a stall when a second of vehicle time begins that has one."""
        if not (self._stalls.stalled and self._stalls.stall_s) or self._due_us is None or time_us < self._due_us:
            return
        self._due_us += 1_000_000
        if self._fate.random() < self._stalls.stalled:
            self.count += 1
            self._stop(self._stalls.stall_s)
