"""Says why a landing does not end, or how the vehicle leans when it has ended.

PX4 says nothing of the kind: a vehicle that hangs on a roof's edge stays armed in LAND without a word, and one that
lies on its side learns it at the next arming.
"""

import math
from collections.abc import Callable

from autopilot.estimator.estimated_state import EstimatedState
from foundation.mavlink import dialect

LANDING = ("LAND", "DESCEND")  # modes that end on the ground
BLOCKED_US = 10_000_000  # µs in LAND without having sunk
SUNK_M = 0.3
UPRIGHT_DEG = 20.0  # from the vertical; the maps' ground slopes less


class LandingWatch:
    """Follows the landings of one vehicle."""

    def __init__(self, say: Callable[[int, str], None]) -> None:
        self._say = say
        self._lowest: tuple[int, float] | None = None  # µs and m, NED: when it last got lower, and how low
        self._is_said = False

    def follow(self, state: EstimatedState, landing: bool) -> None:
        """Follow one tick. `landing`: a landing has been ordered and has not ended."""
        if not landing:
            self._lowest, self._is_said = None, False
            return
        z = state.position_ned[2]
        if self._lowest is None or z > self._lowest[1] + SUNK_M:
            self._lowest = state.time_us, z
        elif state.time_us - self._lowest[0] > BLOCKED_US and not self._is_said:
            self._is_said = True
            self._say(dialect.MAV_SEVERITY_WARNING, f"Landing blocked: not sinking, leans {lean_deg(state):.0f} deg")

    def ended(self, state: EstimatedState) -> None:
        """Look how it stands when the rotors have been stopped."""
        self._lowest, self._is_said = None, False
        if (lean := lean_deg(state)) > UPRIGHT_DEG:
            self._say(dialect.MAV_SEVERITY_WARNING, f"Landed and not upright: leans {lean:.0f} deg")


def lean_deg(state: EstimatedState) -> float:
    """Return the angle (°) between the body's vertical axis and the vertical, 180 upside down."""
    _, x, y, _ = state.attitude
    return math.degrees(math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0)))
