"""When the rotors of a standing vehicle are stopped without being asked: COM_DISARM_LAND and COM_DISARM_PRFLT."""

from autopilot.parameters import ParameterTable


class AutoDisarm:
    """Follows one armed stay on the ground, before a flight or after it."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._armed_us = 0
        self._landed_us: int | None = None
        self._flown = False

    def arm(self, now_us: int) -> None:
        """Begin with the arming."""
        self._armed_us, self._landed_us, self._flown = now_us, None, False

    def reason(self, now_us: int, landed: bool, climbing: bool) -> str:
        """Follow one tick and return why to disarm now, empty to go on. `climbing`: a take-off is wanted."""
        if not landed:
            self._flown, self._landed_us = True, None
            return ""
        if self._landed_us is None:
            self._landed_us = now_us
        if self._flown:
            wait = float(self._parameters["COM_DISARM_LAND"])
            return "after landing" if 0.0 < wait * 1e6 <= now_us - self._landed_us else ""
        wait = float(self._parameters["COM_DISARM_PRFLT"])
        return "without a take-off" if 0.0 < wait * 1e6 <= now_us - self._armed_us and not climbing else ""
