"""Whether the vehicle stands on the ground, with the thresholds of PX4's LNDMC_* parameters."""

import math

from autopilot.estimated_state import EstimatedState
from autopilot.modes.setpoint import CascadeSetpoint
from autopilot.parameters import ParameterTable
from autopilot.records import KIND_TRAJECTORY

# In the air the vertical speed cannot stay near zero while thrust carries clearly less than the weight, so both
# together for LNDMC_TRIG_TIME prove that something else carries the vehicle.
SUPPORTED_THRUST = 0.8  # of hover thrust
RANGE_IN_AIR_M = 1.0  # a fresh range beyond this is never a standing vehicle
LIFT_OFF_M = 0.25
LIFT_OFF_SPEED = 0.3  # m/s


class LandDetector:
    """Keeps `landed`; starts on the ground."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self.landed = True
        self._contact_since_us: int | None = None
        self._ground_z: float | None = None

    def update(self, state: EstimatedState, armed: bool, climbing: bool, demand: CascadeSetpoint) -> None:
        """Follow one tick. `climbing`: the demand wants to leave the ground (`demand` is what the flight mode asks)."""
        if not armed:
            self.landed, self._contact_since_us, self._ground_z = True, None, None
        elif self.landed:
            self._watch_lift_off(state, climbing)
        else:
            self._watch_touch_down(state, demand)

    def _watch_lift_off(self, state: EstimatedState, climbing: bool) -> None:
        z = state.position_ned[2]
        if not climbing or self._ground_z is None:
            self._ground_z = z  # follows the drift of the estimate while the vehicle stands
            return
        risen = self._ground_z - z
        if (risen > LIFT_OFF_M and -state.velocity_ned[2] > 0.1) or -state.velocity_ned[2] > LIFT_OFF_SPEED:
            self.landed, self._contact_since_us = False, None

    def _watch_touch_down(self, state: EstimatedState, demand: CascadeSetpoint) -> None:
        p = self._parameters
        vn, ve, vd = state.velocity_ned
        rate_max = math.radians(p["LNDMC_ROT_MAX"])
        still = (
            abs(vd) < p["LNDMC_Z_VEL_MAX"]
            and math.hypot(vn, ve) < p["LNDMC_XY_VEL_MAX"]
            and abs(state.rates_frd[0]) < rate_max
            and abs(state.rates_frd[1]) < rate_max
        )
        light = state.thrust_setpoint < SUPPORTED_THRUST * state.hover_thrust
        if not (still and light and _descends(state, demand)) or state.range_m() > RANGE_IN_AIR_M:
            self._contact_since_us = None
            return
        if self._contact_since_us is None:
            self._contact_since_us = state.time_us
        elif state.time_us - self._contact_since_us >= p["LNDMC_TRIG_TIME"] * 1e6:
            self.landed, self._ground_z = True, state.position_ned[2]


def _descends(state: EstimatedState, demand: CascadeSetpoint) -> bool:
    if demand.kind != KIND_TRAJECTORY:
        return True  # attitude and rate demands carry their intent in the thrust alone
    z, vz = demand.position_ned[2], demand.velocity_ned[2]
    return vz > 0.05 or z > state.position_ned[2] + 0.1
