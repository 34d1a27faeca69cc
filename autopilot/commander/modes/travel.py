"""How fast to approach a place so that the vehicle can still stop there."""

import math

BRAKING_SHARE = 0.5  # of the acceleration limit: leaves the rest to the position controller
LEAST_SPEED = 1.0  # m/s, keeps the position loop free near the target


def approach_speed(distance: float, cruise: float, acceleration: float) -> float:
    """Return the horizontal speed limit (m/s) at `distance` (m) from the target: v² = 2·a·d, at most `cruise`.

    Quantised to 5 cm/s, so that a setpoint at rest stays bit-identical from tick to tick.
    """
    limit = min(cruise, max(LEAST_SPEED, math.sqrt(2.0 * BRAKING_SHARE * acceleration * distance)))
    return math.ceil(limit * 20.0) / 20.0
