"""The pilot takes over by moving the sticks (COM_RC_OVERRIDE, COM_RC_STICK_OV)."""

from autopilot.commander.arming import STICK_MODES
from autopilot.commander.modes.flight import Sticks
from autopilot.parameters import ParameterTable

AUTO_BIT, OFFBOARD_BIT = 1, 2  # COM_RC_OVERRIDE


def overridable(mode: str, parameters: ParameterTable) -> bool:
    """Return whether stick movements may end this mode."""
    if mode in STICK_MODES or mode in ("TERMINATION", "ORBIT"):  # sticks are part of an orbit
        return False
    bit = OFFBOARD_BIT if mode == "OFFBOARD" else AUTO_BIT
    return bool(int(parameters["COM_RC_OVERRIDE"]) & bit)


class StickOverride:
    """Compares the sticks with where they were when the mode began."""

    def __init__(self) -> None:
        self._mode = ""
        self._reference: tuple[float, float, float, float] | None = None

    def moved(self, mode: str, sticks: Sticks, parameters: ParameterTable) -> bool:
        """Return whether a fresh stick has moved by more than COM_RC_STICK_OV (% of full deflection) in this mode."""
        now = (sticks.forward, sticks.right, sticks.yaw, 2.0 * sticks.throttle - 1.0)
        if mode != self._mode or self._reference is None:
            self._mode, self._reference = mode, now
            return False
        limit = 0.01 * float(parameters["COM_RC_STICK_OV"])
        return any(abs(a - b) > limit for a, b in zip(now, self._reference, strict=True))
