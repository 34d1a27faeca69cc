"""Whether the vehicle has turned over: PX4's failure detector for roll and pitch."""

import math

from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable


class AttitudeWatch:
    """`failed` once roll or pitch has exceeded FD_FAIL_R or FD_FAIL_P (°, 0 = off) for FD_FAIL_R_TTRI or _P_TTRI."""

    def __init__(self, parameters: ParameterTable) -> None:
        self.failed = False
        self._parameters = parameters
        self._since_us: list[int | None] = [None, None]

    def reset(self) -> None:
        """Forget what was seen."""
        self.failed, self._since_us = False, [None, None]

    def look(self, state: EstimatedState, *, controlled: bool) -> None:
        """Follow one look. `controlled`: the mode controls the attitude; a pilot in ACRO may turn over on purpose."""
        self.failed = False
        for i, name in enumerate(("FD_FAIL_R", "FD_FAIL_P")):
            limit = float(self._parameters[name])
            beyond = controlled and limit > 0.0 and abs(state.euler[i]) > math.radians(limit)
            if not beyond:
                self._since_us[i] = None
                continue
            since = self._since_us[i]
            if since is None:
                self._since_us[i] = since = state.time_us
            self.failed |= state.time_us - since >= self._parameters[f"{name}_TTRI"] * 1e6
