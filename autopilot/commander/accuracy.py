"""How uncertain an estimate may become in flight: COM_POS_FS_EPH and COM_VEL_FS_EVH, with PX4's hysteresis.

What is in use is believed until its deviation passes 2.5 times the parameter; what is not, once it has been below the
parameter itself for a second. A negative parameter switches the check off. Source: the parameter reference of PX4 1.15
and its `EstimatorChecks`, as far as behaviour goes.

One thing is ours. Our estimator owns a blow: its velocity is uncertain by metres a second until the next fix puts it
right, a tenth of a second later, while PX4's filter is told of no blow and never says so. The deviation of a velocity
therefore has to last before it is one too many, or every bump into a lamp post would end in a failsafe.
"""

import math

from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable

IN_USE = 2.5  # times the parameter
PROBATION_US = 1_000_000
LASTING_US = 500_000


def required(parameters: ParameterTable, name: str) -> float:
    """Return the deviation (m or m/s) that COM_POS_FS_EPH or COM_VEL_FS_EVH asks for, inf where it is switched off."""
    value = float(parameters[name])
    return value if value >= 0.0 else math.inf


class _Hysteresis:
    """One quantity: believed or not."""

    def __init__(self, lasting_us: int = 0) -> None:
        """`lasting_us`: how long a deviation has to last, µs."""
        self._lasting_us = lasting_us
        self._believed = True
        self._failed_us = 0
        self._good_us = 0  # when it was last as certain as it has to be

    def limit(self, now_us: int, valid: bool, deviation: float, wanted: float) -> float:
        """Return the deviation from which on it is not believed; below any deviation while it is on probation."""
        if valid and deviation < (wanted * IN_USE if self._believed else wanted):
            self._good_us = now_us
            if now_us - self._failed_us >= PROBATION_US:
                self._believed = True
        elif not (valid and self._believed and now_us - self._good_us < self._lasting_us):
            self._believed, self._failed_us = False, now_us
        if not self._believed:
            return -math.inf
        return math.inf if self._lasting_us else wanted * IN_USE


class AccuracyWatch:
    """Sets the limits of a vehicle's state while it flies. Call `look` about ten times a second."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._position, self._velocity = _Hysteresis(), _Hysteresis(LASTING_US)
        self._limited: EstimatedState | None = None

    def reset(self) -> None:
        """Believe the estimator's own flags until the next look: the vehicle was armed or disarmed."""
        self._position, self._velocity = _Hysteresis(), _Hysteresis(LASTING_US)
        if self._limited is not None:
            self._limited.position_limit = self._limited.velocity_limit = math.inf

    def look(self, state: EstimatedState) -> None:
        """Follow the deviations. The record is read, since the snapshot shows what the limits have made of it."""
        self._limited = state
        now, p, e = state.time_us, self._parameters, state.estimate
        state.position_limit = self._position.limit(
            now, bool(e["position_valid"]), float(e["position_std_h"]), required(p, "COM_POS_FS_EPH")
        )
        state.velocity_limit = self._velocity.limit(
            now, bool(e["velocity_valid"]), float(e["velocity_std_h"]), required(p, "COM_VEL_FS_EVH")
        )
