"""The modes around a point: FOLLOW stays beside a moving target (PX4's FLW_TGT_*), ORBIT circles a place."""

import math

from autopilot.commander.modes.automatic import approach_speed
from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.manual import shaped
from autopilot.records import CascadeSetpoint
from foundation.frames import Vec3, wrap_pi

TARGET_TIMEOUT_US = 3_000_000  # a target that has been silent for longer is waited for on the spot
COURSE_SPEED = 1.0  # m/s, a slower target keeps the course it had
HEIGHT_LEAST = 1.0  # m; FLW_TGT_HT below this has no effect
CONSTANT, TERRAIN, TARGET = range(3)  # FLW_TGT_ALT_M


class Follow(Mode):
    """Until the first FOLLOW_TARGET, and after the last one, it stays where it is."""

    def __init__(self) -> None:
        self._place: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0
        self._course = math.nan  # rad, of the target
        self._seen: Vec3 | None = None  # m, filtered place of the target
        self._time_us = 0

    def enter(self, flight: FlightContext) -> None:
        self._place, self._yaw = flight.state.position_ned, flight.state.yaw
        self._seen, self._course, self._time_us = None, math.nan, flight.state.time_us

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        state, p, target = flight.state, flight.parameters, flight.target
        dt = (state.time_us - self._time_us) * 1e-6
        self._time_us = state.time_us
        n, e, _ = state.position_ned
        speed, velocity = flight.cruise(), (0.0, 0.0)
        if target.time_us >= 0 and state.time_us - target.time_us < TARGET_TIMEOUT_US:
            self._track(flight, dt)
            self._place = self._wanted(flight)
            speed = float(p["FLW_TGT_MAX_VEL"])
            velocity = target.velocity_ned[0], target.velocity_ned[1]
        if self._seen is not None and math.hypot(self._seen[0] - n, self._seen[1] - e) > 1.0:
            self._yaw = math.atan2(self._seen[1] - e, self._seen[0] - n)
        distance = math.hypot(self._place[0] - n, self._place[1] - e)
        return CascadeSetpoint(
            position_ned=self._place,
            velocity_ned=(velocity[0], velocity[1], 0.0),
            yaw=self._yaw,
            speed_limit_up=float(p["MPC_Z_V_AUTO_UP"]),
            speed_limit_down=float(p["MPC_Z_V_AUTO_DN"]),
            speed_limit_horizontal=approach_speed(distance, speed, float(p["MPC_ACC_HOR"])) + math.hypot(*velocity),
        )

    def _track(self, flight: FlightContext, dt: float) -> None:
        """Filter the target's place with the time constant FLW_TGT_RS (s), carried on by its velocity meanwhile."""
        target, age = flight.target, (flight.state.time_us - flight.target.time_us) * 1e-6
        vn, ve, vd = target.velocity_ned
        now = (
            target.position_ned[0] + vn * age, target.position_ned[1] + ve * age, target.position_ned[2] + vd * age
        )  # fmt: skip
        if self._seen is None:
            self._seen = now
            # an unmoving target has no course: stay on the side where the vehicle is
            here, angle = flight.state.position_ned, math.radians(flight.parameters["FLW_TGT_FA"])
            self._course = math.atan2(here[1] - now[1], here[0] - now[0]) - angle
        share = dt / (float(flight.parameters["FLW_TGT_RS"]) + dt) if dt > 0.0 else 0.0
        s = self._seen
        self._seen = (s[0] + share * (now[0] - s[0]), s[1] + share * (now[1] - s[1]), s[2] + share * (now[2] - s[2]))
        if math.hypot(vn, ve) > COURSE_SPEED:
            self._course = math.atan2(ve, vn)

    def _wanted(self, flight: FlightContext) -> Vec3:
        p = flight.parameters
        assert self._seen is not None
        bearing = self._course + math.radians(p["FLW_TGT_FA"])  # 0 ahead of the target, 180 behind
        distance, height = float(p["FLW_TGT_DST"]), max(float(p["FLW_TGT_HT"]), HEIGHT_LEAST)
        how = p["FLW_TGT_ALT_M"]
        ground = flight.home.position_ned[2] if flight.home is not None else 0.0
        if how == TARGET and math.isfinite(self._seen[2]):
            ground = min(self._seen[2], ground)  # never below the height above home that is asked for
        elif how == TERRAIN and math.isfinite(flight.state.range_m()):
            ground = flight.state.position_ned[2] + flight.state.range_m()
        return (
            self._seen[0] + distance * math.cos(bearing),
            self._seen[1] + distance * math.sin(bearing),
            ground - height,
        )


CAPTURE_GAIN = 0.8  # 1/s, radial error to radial speed
LEAD_S = 0.4  # s, by which the velocity follows a setpoint late; measured with the x500 on circles of 8 to 40 m
ACCELERATION = 2.0  # m/s², most that a circle may take: PX4's FlightTaskOrbit
RADIUS_LEAST = 1.0  # m
SPEED_MOST = 10.0  # m/s
STICK_RADIUS_RATE = 2.0  # m/s at full deflection of pitch
STICK_SPEED_RATE = 1.0  # m/s² at full deflection of roll
TO_CENTRE, INITIAL, FREE_YAW, ALONG, BY_STICK = range(5)  # ORBIT_YAW_BEHAVIOUR


def speed_limit(radius: float) -> float:
    """Return the greatest speed (m/s) on a circle of this radius (m)."""
    return min(SPEED_MOST, math.sqrt(ACCELERATION * radius))


class Orbit(Mode):
    """Positive radius circles clockwise, negative counter-clockwise."""

    def __init__(self) -> None:
        self.centre: Vec3 | None = None
        self.radius = 10.0  # m, > 0
        self.speed = 2.0  # m/s, signed: positive clockwise
        self.yaw_behaviour = TO_CENTRE
        self._yaw = 0.0
        self._time_us = 0

    def around(self, centre_ned: Vec3 | None, radius: float, speed: float, yaw_behaviour: int = TO_CENTRE) -> None:
        """Choose the circle; None = around the place where the mode is entered. The speed is cut to what flies."""
        self.centre, self.radius = centre_ned, max(abs(radius), RADIUS_LEAST)
        self.speed = math.copysign(min(abs(speed), speed_limit(self.radius)), radius)
        self.yaw_behaviour = yaw_behaviour

    def enter(self, flight: FlightContext) -> None:
        self._yaw, self._time_us = flight.state.yaw, flight.state.time_us
        if self.centre is None:
            self.centre = flight.state.position_ned

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        self._listen(flight)
        centre = self.centre or flight.state.position_ned
        n, e, _ = flight.state.position_ned
        dn, de = n - centre[0], e - centre[1]
        distance = math.hypot(dn, de)
        un, ue = (dn / distance, de / distance) if distance > 0.1 else (1.0, 0.0)
        captured = max(-abs(self.speed) - 2.0, min(abs(self.speed) + 2.0, CAPTURE_GAIN * (self.radius - distance)))
        on_circle = abs(distance - self.radius) < max(2.0, 0.3 * self.radius)
        tangential = self.speed if on_circle else 0.0
        turn = tangential / max(distance, 1.0)
        # The setpoint is where the velocity is to be after the lag. The smoothed velocity brings its own acceleration
        # with it: a second one from here would pull the vehicle inside the circle.
        radial = captured - LEAD_S * turn * tangential
        yaw, yaw_rate = self._heading(flight, wrap_pi(math.atan2(-ue, -un)), turn, on_circle)
        return CascadeSetpoint(
            position_ned=(math.nan, math.nan, centre[2]),
            velocity_ned=(un * radial - ue * tangential, ue * radial + un * tangential, math.nan),
            yaw=yaw,
            yaw_rate=yaw_rate,
            speed_limit_up=float(flight.parameters["MPC_Z_V_AUTO_UP"]),
            speed_limit_down=float(flight.parameters["MPC_Z_V_AUTO_DN"]),
        )

    def _heading(self, flight: FlightContext, inwards: float, turn: float, on_circle: bool) -> tuple[float, float]:
        """Return (yaw, yaw rate) of the behaviour that was asked for; an approach looks at the centre."""
        if self.yaw_behaviour == INITIAL:
            return self._yaw, 0.0
        if self.yaw_behaviour == FREE_YAW:
            return math.nan, 0.0
        if self.yaw_behaviour == BY_STICK:
            stick = shaped(flight.sticks.yaw, flight.parameters, "MPC_YAW_EXPO")
            return math.nan, stick * math.radians(flight.parameters["MPC_MAN_Y_MAX"])
        if self.yaw_behaviour == ALONG and on_circle:
            return wrap_pi(inwards - math.copysign(0.5 * math.pi, self.speed)), turn
        return inwards, turn

    def _listen(self, flight: FlightContext) -> None:
        """Let fresh sticks change the circle: pitch its radius, roll the speed."""
        dt = min((flight.state.time_us - self._time_us) * 1e-6, 0.1)
        self._time_us = flight.state.time_us
        p, sticks = flight.parameters, flight.sticks
        if not sticks.fresh(self._time_us, p["COM_RC_LOSS_T"]):
            return
        inwards = shaped(sticks.forward, p, "MPC_XY_MAN_EXPO")
        self.radius -= inwards * STICK_RADIUS_RATE * dt
        self.radius = min(max(self.radius, RADIUS_LEAST), float(p["MC_ORBIT_RAD_MAX"]))
        most = speed_limit(self.radius)
        # to the right of a vehicle that looks inwards is counter-clockwise
        self.speed = min(
            max(self.speed - shaped(sticks.right, p, "MPC_XY_MAN_EXPO") * STICK_SPEED_RATE * dt, -most), most
        )
