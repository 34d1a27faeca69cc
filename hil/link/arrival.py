"""When a vehicle has come to rest at a place that it was sent to."""

import math

from foundation.frames import Vec3, wrap_pi
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
