"""Take-off and landing: take-off ramp, land detector, warnings about landings, and automatic disarming.

The ramp is PX4's take-off handling: spool-up, ready, ramp, flight. It does not change attitude and rate setpoints,
because the pilot sets their thrust. The thresholds of the land detector are PX4's LNDMC_* parameters.

PX4 does not report a failed landing. A vehicle that hangs on a roof's edge stays armed in LAND. A vehicle that lies on
its side reports this only at the next arming. Here `LandingWatch` warns in both cases.
"""

import math

from autopilot.commander.health import StatusText
from autopilot.control.position import SIDEWAYS_SPEED
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.parameters import ParameterTable
from autopilot.records import IDLE, KIND_IDLE, KIND_TRAJECTORY, NAN, CascadeSetpoint
from foundation.mavlink import dialect

WANTS_CLIMB_SPEED = 0.3  # m/s; a faster upward setpoint demands a climb
WANTS_CLIMB_M = 0.3  # m; a height setpoint that is farther above the vehicle demands a climb
RAMP_START = 0.15  # first thrust limit of the ramp; far below hover for every airframe


def wants_climb(setpoint: CascadeSetpoint, state: EstimatedState) -> bool:
    """Return whether a setpoint commands the vehicle to leave the ground."""
    if setpoint.kind == KIND_IDLE:
        return False
    if setpoint.kind != KIND_TRAJECTORY:
        return setpoint.thrust > 0.7 * state.hover_thrust
    z, vz, az = setpoint.position_ned[2], setpoint.velocity_ned[2], setpoint.acceleration_ned[2]
    if math.isfinite(z):
        return z < state.position_ned[2] - WANTS_CLIMB_M
    if math.isfinite(vz):
        return vz < -WANTS_CLIMB_SPEED
    return az < -1.0


class TakeoffRamp:
    """Limits trajectory setpoints on the ground and during the take-off."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._armed_us = 0
        self._ramp_us: int | None = None

    def arm(self, now_us: int) -> None:
        """Start the spool-up."""
        self._armed_us, self._ramp_us = now_us, None

    def gate(self, setpoint: CascadeSetpoint, state: EstimatedState, landed: bool) -> CascadeSetpoint:
        """Return the limited setpoint: idle on the ground, thrust-limited in the ramp, unchanged in flight."""
        if setpoint.kind != KIND_TRAJECTORY:
            return setpoint
        now = state.time_us
        if landed and not wants_climb(setpoint, state):
            self._ramp_us = None
            return IDLE
        if landed and now - self._armed_us < self._parameters["COM_SPOOLUP_TIME"] * 1e6:
            return IDLE
        if self._ramp_us is None:
            if not landed:
                return setpoint
            self._ramp_us = now
        ramp_s = float(self._parameters["MPC_TKO_RAMP_T"])
        elapsed = (now - self._ramp_us) * 1e-6
        if elapsed >= ramp_s:
            if not landed:
                self._ramp_us = None
            return setpoint
        # a tilt on the ground overturns the vehicle, so horizontal motion starts in the air
        upright = setpoint
        if landed:
            z, vz, az = setpoint.position_ned[2], setpoint.velocity_ned[2], setpoint.acceleration_ned[2]
            upright = setpoint._replace(
                position_ned=(NAN, NAN, z), velocity_ned=(0.0, 0.0, vz), acceleration_ned=(0.0, 0.0, az)
            )
        return upright._replace(thrust_limit=RAMP_START + (1.0 - RAMP_START) * elapsed / ramp_s)


# A vehicle in the air sinks if its thrust is clearly below hover thrust. If the thrust is low and the vertical speed
# stays near zero for LNDMC_TRIG_TIME, then the ground carries the vehicle.
SUPPORTED_THRUST = 0.8  # fraction of hover thrust; less counts as low
RANGE_IN_AIR_M = 1.0  # if the rangefinder measures more, the vehicle is in the air
LIFT_OFF_M = 0.25  # m; a vehicle that has risen by more and still climbs is in the air
LIFT_OFF_SPEED = 0.3  # m/s; a vehicle that climbs faster is in the air


CONTACT_SPEED = 0.3  # m/s downwards; a setpoint at least this fast demands a descent
CONTACT_M = 0.5  # m; a height setpoint that is farther below the vehicle demands a descent
CONTACT_SHARE = 0.3  # fraction of the demanded descent; if the vehicle descends less, something carries it


class LandDetector:
    """Detects `landed` (True at first) and `contact`, which means that the vehicle does not follow a demand to descend.

    PX4 has three stages of LNDMC_TRIG_TIME / 3 each; `contact` corresponds to the first stage, `landed` to the last.
    """

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self.landed, self.contact = True, False
        self._contact_since_us: int | None = None
        self._dive: tuple[int, float] | None = None  # time (µs) and z (m, NED) at which the demanded descent began
        self._ground_z: float | None = None

    def update(self, state: EstimatedState, armed: bool, climbing: bool, demand: CascadeSetpoint) -> None:
        """Update with one tick. `demand`: the setpoint of the flight mode; `climbing`: the result of `wants_climb`."""
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
        """Compare the achieved descent with the demanded descent over LNDMC_TRIG_TIME / 3.

        A vehicle that sinks at CONTACT_SPEED or faster has no contact.
        """
        speed, z = _dive(state, demand), state.position_ned[2]
        if speed is None or state.range_m() > RANGE_IN_AIR_M:
            self.contact, self._dive = False, None
        elif self._dive is None:
            if state.velocity_ned[2] > -CONTACT_SPEED:  # not while the vehicle still climbs
                self._dive = state.time_us, z
        else:
            since, above = self._dive
            elapsed = (state.time_us - since) * 1e-6
            if elapsed >= self._parameters["LNDMC_TRIG_TIME"] / 3.0:
                is_short = z - above < CONTACT_SHARE * speed * elapsed
                self.contact = is_short and state.velocity_ned[2] < CONTACT_SPEED
                self._dive = state.time_us, z

    def _watch_touch_down(self, state: EstimatedState, demand: CascadeSetpoint) -> None:
        self._watch_contact(state, demand)
        light = state.thrust_setpoint < SUPPORTED_THRUST * state.hover_thrust
        if not (light and self._is_still(state) and _descends(state, demand)) or state.range_m() > RANGE_IN_AIR_M:
            self._contact_since_us = None
            return
        if self._contact_since_us is None:
            self._contact_since_us = state.time_us
        elif state.time_us - self._contact_since_us >= self._parameters["LNDMC_TRIG_TIME"] * 1e6:
            self.landed, self._ground_z = True, state.position_ned[2]

    def _is_still(self, state: EstimatedState) -> bool:
        p = self._parameters
        vn, ve, vd = state.velocity_ned
        rate_max = math.radians(p["LNDMC_ROT_MAX"])
        return (
            abs(vd) < p["LNDMC_Z_VEL_MAX"]
            and math.hypot(vn, ve) < p["LNDMC_XY_VEL_MAX"]
            and abs(state.rates_frd[0]) < rate_max
            and abs(state.rates_frd[1]) < rate_max
        )


def _dive(state: EstimatedState, demand: CascadeSetpoint) -> float | None:
    """Return the least sink speed (m/s) that `demand` asks for; None if `demand` is not a clear descent.

    A demand with a horizontal speed above SIDEWAYS_SPEED does not count: the vehicle might slide along an obstacle.
    """
    north, east, vz = demand.velocity_ned
    sinks = vz >= CONTACT_SPEED
    if not sinks and not demand.position_ned[2] > state.position_ned[2] + CONTACT_M:
        return None
    if demand.kind != KIND_TRAJECTORY or math.hypot(north, east) > SIDEWAYS_SPEED:
        return None
    return min(vz, demand.speed_limit_down) if sinks else CONTACT_SPEED


def _descends(state: EstimatedState, demand: CascadeSetpoint) -> bool:
    if demand.kind != KIND_TRAJECTORY:
        return True  # for an attitude or rate demand, only the thrust counts
    z, vz = demand.position_ned[2], demand.velocity_ned[2]
    return vz > 0.05 or z > state.position_ned[2] + 0.1


LANDING = ("LAND", "DESCEND")  # modes that end on the ground
BLOCKED_US = 10_000_000  # µs; a landing is blocked if the vehicle sinks by less than SUNK_M in this time
SUNK_M = 0.3
UPRIGHT_DEG = 20.0  # a landed vehicle that leans more is not upright; no ground is so steep


class LandingWatch:
    """Warns of a blocked landing, and of a vehicle that is not upright after landing."""

    def __init__(self, send_text: StatusText) -> None:
        self._send_text = send_text
        self._lowest: tuple[int, float] | None = None  # time (µs) and z (m, NED) after the last SUNK_M of descent
        self._has_warned = False

    def follow(self, state: EstimatedState, landing: bool) -> None:
        """Update with one tick. `landing`: whether the mode is one of LANDING, and the vehicle has not landed yet."""
        if not landing:
            self._lowest, self._has_warned = None, False
            return
        z = state.position_ned[2]
        if self._lowest is None or z > self._lowest[1] + SUNK_M:
            self._lowest = state.time_us, z
        elif state.time_us - self._lowest[0] > BLOCKED_US and not self._has_warned:
            self._has_warned = True
            self._send_text(
                dialect.MAV_SEVERITY_WARNING, f"Landing blocked: not sinking, leans {lean_deg(state):.0f} deg"
            )

    def ended(self, state: EstimatedState) -> None:
        """Check the attitude after disarming."""
        self._lowest, self._has_warned = None, False
        if (lean := lean_deg(state)) > UPRIGHT_DEG:
            self._send_text(dialect.MAV_SEVERITY_WARNING, f"Landed and not upright: leans {lean:.0f} deg")


def lean_deg(state: EstimatedState) -> float:
    """Return the angle (°) between the body's vertical axis and the vertical; 180 is upside down."""
    _, x, y, _ = state.attitude
    return math.degrees(math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0)))


class AutoDisarm:
    """Decides when a vehicle that stays armed on the ground must disarm."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._armed_us = 0
        self._landed_us: int | None = None
        self._was_airborne = False

    def arm(self, now_us: int) -> None:
        self._armed_us, self._landed_us, self._was_airborne = now_us, None, False

    def reason(self, now_us: int, landed: bool, climbing: bool) -> str:
        """Update with one tick; return the reason to disarm now, empty for none. `climbing`: a take-off is demanded."""
        if not landed:
            self._was_airborne, self._landed_us = True, None
            return ""
        if self._landed_us is None:
            self._landed_us = now_us
        if self._was_airborne and climbing:
            self._landed_us = now_us  # the next take-off has begun
            return ""
        if self._was_airborne:
            wait = float(self._parameters["COM_DISARM_LAND"])
            return "after landing" if 0.0 < wait * 1e6 <= now_us - self._landed_us else ""
        wait = float(self._parameters["COM_DISARM_PRFLT"])
        return "without a take-off" if 0.0 < wait * 1e6 <= now_us - self._armed_us and not climbing else ""
