"""Whether the vehicle stands on the ground, with the thresholds of PX4's LNDMC_* parameters."""

import math

from autopilot.commander.modes.setpoint import CascadeSetpoint
from autopilot.control.position import ASIDE
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from autopilot.records import KIND_TRAJECTORY

# In the air the vertical speed cannot stay near zero while thrust carries clearly less than the weight, so both
# together for LNDMC_TRIG_TIME prove that something else carries the vehicle.
SUPPORTED_THRUST = 0.8  # of hover thrust
RANGE_IN_AIR_M = 1.0  # a fresh range beyond this is never a standing vehicle
LIFT_OFF_M = 0.25
LIFT_OFF_SPEED = 0.3  # m/s


CONTACT_SPEED = 0.3  # m/s downwards, from which on a demand has to move a vehicle that is in the air
CONTACT_M = 0.5  # m below the vehicle, the same for a demanded height
CONTACT_SHARE = 0.3  # of what is demanded: a vehicle that descends less is carried


class LandDetector:
    """Keeps `landed`, which begins true, and `contact`: it should descend and does not, so something carries it.

    PX4 has three stages of a third of LNDMC_TRIG_TIME each, of which `contact` is the first and `landed` the last.
    """

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self.landed, self.contact = True, False
        self._contact_since_us: int | None = None
        self._dive: tuple[int, float] | None = None  # µs and m, NED: since when and from where it should descend
        self._ground_z: float | None = None

    def update(self, state: EstimatedState, armed: bool, climbing: bool, demand: CascadeSetpoint) -> None:
        """Follow one tick. `climbing`: the demand wants to leave the ground (`demand` is what the flight mode asks)."""
        if not armed:
            self.landed, self._contact_since_us, self._ground_z = True, None, None
            self.contact, self._dive = False, None
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

    def _watch_contact(self, state: EstimatedState, demand: CascadeSetpoint) -> None:
        """Compare what a demand to descend achieves with what it asks for, over a third of LNDMC_TRIG_TIME."""
        speed, z = _dive(state, demand), state.position_ned[2]
        if speed is None or state.range_m() > RANGE_IN_AIR_M:
            self.contact, self._dive = False, None
        elif self._dive is None:
            if state.velocity_ned[2] > -CONTACT_SPEED:  # not while a climb is still being stopped
                self._dive = state.time_us, z
        else:
            since, above = self._dive
            elapsed = (state.time_us - since) * 1e-6
            if elapsed >= self._parameters["LNDMC_TRIG_TIME"] / 3.0:
                self.contact, self._dive = z - above < CONTACT_SHARE * speed * elapsed, (state.time_us, z)

    def _watch_touch_down(self, state: EstimatedState, demand: CascadeSetpoint) -> None:
        p = self._parameters
        self._watch_contact(state, demand)
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


def _dive(state: EstimatedState, demand: CascadeSetpoint) -> float | None:
    """Return the speed (m/s) at which a demand descends at least; None where a vehicle in the air need not follow.

    A demand that leads aside as well is no landing: what carries the vehicle is an obstacle, which it may slide along.
    """
    north, east, _ = demand.velocity_ned
    if demand.kind != KIND_TRAJECTORY or math.hypot(north, east) > ASIDE:
        return None
    z, vz = demand.position_ned[2], demand.velocity_ned[2]
    if vz >= CONTACT_SPEED:
        return vz
    return CONTACT_SPEED if z > state.position_ned[2] + CONTACT_M else None


def _descends(state: EstimatedState, demand: CascadeSetpoint) -> bool:
    if demand.kind != KIND_TRAJECTORY:
        return True  # attitude and rate demands carry their intent in the thrust alone
    z, vz = demand.position_ned[2], demand.velocity_ned[2]
    return vz > 0.05 or z > state.position_ned[2] + 0.1
