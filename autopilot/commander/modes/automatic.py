"""Automatic modes without a plan: HOLD, TAKEOFF, LAND, DESCEND, RETURN (PX4's RTL_TYPE 0), FOLLOW and ORBIT.

FOLLOW stays beside a moving target (PX4's FLW_TGT_*). ORBIT circles a point.
"""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.manual import shaped, stick_turn
from autopilot.commander.plans import Home, local_place
from autopilot.records import IDLE, NAN, CascadeSetpoint
from foundation.frames import Vec3, wrap_pi

BRAKING_SHARE = 0.5  # fraction of MPC_ACC_HOR for braking; the position controller needs the rest
LEAST_SPEED = 1.0  # m/s, lowest value of `approach_speed`: near the target the position loop slows the vehicle


def approach_speed(distance: float, cruise: float, acceleration: float) -> float:
    """Return the horizontal speed limit v (m/s) at distance d (m) from the target: v² = 2·a·d, at most `cruise`.

    a is BRAKING_SHARE · `acceleration` (m/s²). v is rounded up to a multiple of 5 cm/s, so that the setpoint of a
    hovering vehicle is the same at each tick.
    """
    limit = min(cruise, max(LEAST_SPEED, math.sqrt(2.0 * BRAKING_SHARE * acceleration * distance)))
    return math.ceil(limit * 20.0) / 20.0


def cruising(flight: FlightContext, place_ned: Vec3, yaw: float, distance: float) -> CascadeSetpoint:
    """Return the setpoint of a flight to a place (m, NED), with the speed limits of automatic flight.

    `distance` (m) is the horizontal distance to the target.
    """
    p = flight.parameters
    return CascadeSetpoint(
        position_ned=place_ned,
        yaw=yaw,
        speed_limit_up=float(p["MPC_Z_V_AUTO_UP"]),
        speed_limit_down=float(p["MPC_Z_V_AUTO_DN"]),
        speed_limit_horizontal=approach_speed(distance, flight.cruise(), float(p["MPC_ACC_HOR"])),
    )


STOPPED_SPEED = 0.3  # m/s; below it the vehicle counts as stopped, and HOLD stores its position
BRAKE_LIMIT_US = 6_000_000  # longest braking; then HOLD stores the position at any speed


class HoldMode(Mode):
    """HOLD: brakes, stores the position at which the vehicle is slow, and holds it. `go_to` sets another position."""

    def __init__(self) -> None:
        self._target: Vec3 | None = None
        self._yaw = 0.0
        self._entered_us = 0

    def enter(self, flight: FlightContext) -> None:
        state = flight.state
        self._target, self._yaw, self._entered_us = None, state.yaw, state.time_us

    def go_to(self, position_ned: Vec3, yaw: float) -> None:
        """Fly to a local position (m, NED); a nan yaw (rad) keeps the present heading."""
        self._target = position_ned
        if math.isfinite(yaw):
            self._yaw = yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        state = flight.state
        if self._target is None:
            vn, ve, vd = state.velocity_ned
            slow = math.sqrt(vn * vn + ve * ve + vd * vd) < STOPPED_SPEED
            if not slow and not flight.landed and state.time_us - self._entered_us < BRAKE_LIMIT_US:
                return CascadeSetpoint(velocity_ned=(0.0, 0.0, 0.0), yaw=self._yaw, yaw_rate=0.0)
            self._target = state.position_ned
        target = self._target
        distance = math.hypot(target[0] - state.position_ned[0], target[1] - state.position_ned[1])
        return cruising(flight, target, self._yaw, distance)


ARRIVED_M = 0.3
LEAST_CLIMB_M = 0.5


class Takeoff(Mode):
    """TAKEOFF: climbs at MPC_TKO_SPEED above the position at which the vehicle entered the mode."""

    def __init__(self) -> None:
        self._target: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0
        self._wanted_z = math.nan

    def aim(self, z_ned: float) -> None:
        """Set the z (m, NED) of the next climb. nan: MIS_TAKEOFF_ALT above the ground; in the air, above home."""
        self._wanted_z = z_ned

    def enter(self, flight: FlightContext) -> None:
        self.next_mode = None
        n, e, z = flight.state.position_ned
        target = z - float(flight.parameters["MIS_TAKEOFF_ALT"])
        # a z that needs no climb is ignored, and so is nan; clients that choose no height send 0
        if self._wanted_z < z - LEAST_CLIMB_M:
            target = self._wanted_z
        elif not flight.landed and flight.home is not None:
            # never descend
            target = min(flight.home.position_ned[2] - float(flight.parameters["MIS_TAKEOFF_ALT"]), z)
        self._wanted_z = math.nan
        self.rest = self._target = (n, e, target)
        self._yaw = flight.state.yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        if not flight.landed and flight.state.position_ned[2] - self._target[2] < ARRIVED_M:
            self.next_mode = "HOLD"
        return CascadeSetpoint(
            position_ned=self._target,
            yaw=self._yaw,
            speed_limit_up=float(flight.parameters["MPC_TKO_SPEED"]),
            speed_limit_horizontal=2.0,
        )


LANDING_STOPPED_SPEED = 0.5  # m/s, horizontal; below it LAND stores the position


def landing_speed(flight: FlightContext) -> float:
    """Return the sink rate (m/s): MPC_Z_V_AUTO_DN above MPC_LAND_ALT1, MPC_LAND_SPEED below MPC_LAND_ALT2."""
    p = flight.parameters
    high, low = float(p["MPC_LAND_ALT1"]), float(p["MPC_LAND_ALT2"])
    fast, slow = float(p["MPC_Z_V_AUTO_DN"]), float(p["MPC_LAND_SPEED"])
    share = (flight.height_above_ground() - low) / max(high - low, 0.1)
    return slow + (max(fast, slow) - slow) * min(max(share, 0.0), 1.0)


class Land(Mode):
    """LAND: stops, stores the position and descends there. The commander disarms the vehicle after landing."""

    def __init__(self) -> None:
        self._place: Vec3 | None = None
        self._yaw = 0.0

    def enter(self, flight: FlightContext, place_ned: Vec3 | None = None) -> None:
        """Land at a local position (m, NED), by default at the position where the vehicle stops."""
        self._place, self._yaw = place_ned, flight.state.yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        state, sink = flight.state, landing_speed(flight)
        if self._place is None and math.hypot(state.velocity_ned[0], state.velocity_ned[1]) < LANDING_STOPPED_SPEED:
            self._place = state.position_ned
        if self._place is None:
            return CascadeSetpoint(velocity_ned=(0.0, 0.0, sink), yaw=self._yaw, speed_limit_down=max(sink, 1.5))
        return CascadeSetpoint(
            position_ned=(self._place[0], self._place[1], NAN),
            velocity_ned=(NAN, NAN, sink),
            yaw=self._yaw,
            speed_limit_down=max(sink, 1.5),
            speed_limit_horizontal=2.0,
        )


class Descend(Mode):
    """DESCEND: descends at MPC_LAND_SPEED without holding a position. Used if the position or the sticks are lost."""

    def __init__(self) -> None:
        self._yaw = 0.0

    def enter(self, flight: FlightContext) -> None:
        self._yaw = flight.state.yaw

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        sink = float(flight.parameters["MPC_LAND_SPEED"])
        if flight.state.velocity_valid:
            return CascadeSetpoint(velocity_ned=(0.0, 0.0, sink), yaw=self._yaw)
        return CascadeSetpoint(velocity_ned=(NAN, NAN, sink), acceleration_ned=(0.0, 0.0, NAN), yaw=self._yaw)


RETURN_ARRIVED_M = 1.0


def return_height(flight: FlightContext, distance: float, height: float) -> float:
    """Return the cruise height of RETURN, from the horizontal `distance` and the present `height`, all in m.

    Heights are above the landing place. Within RTL_MIN_DIST the result is `height`. Farther away it is RTL_RETURN_ALT
    or, if lower, the height of a cone over the landing place (half-angle RTL_CONE_ANG), but at least `height`.
    """
    p = flight.parameters
    if distance < p["RTL_MIN_DIST"]:
        return height
    wanted = float(p["RTL_RETURN_ALT"])
    cone = float(p["RTL_CONE_ANG"])
    if 0.0 < cone < 90.0:
        wanted = min(wanted, distance / math.tan(math.radians(cone)))
    return max(wanted, height)


def safe_places(flight: FlightContext) -> list[Vec3]:
    """Return the landing places (m, NED): home first, then the rally points with a known position.

    Without home, the vehicle's present position is the first one.
    """
    home: Home | None = flight.home
    places = [home.position_ned if home is not None else flight.state.position_ned]
    for item in flight.plans.rally:
        place = local_place(item, flight.state, home)
        if all(math.isfinite(x) for x in place):
            places.append(place)
    return places


class ReturnHome(Mode):
    """RETURN: climbs, flies to the nearest safe place, waits there at RTL_DESCEND_ALT, and lands.

    The wait is RTL_LAND_DELAY (s); 0 means no wait, a negative value an endless wait.
    """

    def __init__(self) -> None:
        self._leg = "climb"
        self._start: Vec3 = (0.0, 0.0, 0.0)
        self._goal: Vec3 = (0.0, 0.0, 0.0)
        self._z = 0.0
        self._yaw = 0.0
        self._since_us: int | None = None
        self._land = Land()

    def enter(self, flight: FlightContext) -> None:
        n, e, z = flight.state.position_ned
        self._goal = min(safe_places(flight), key=lambda place: math.hypot(place[0] - n, place[1] - e))
        distance = math.hypot(self._goal[0] - n, self._goal[1] - e)
        self._leg, self._start, self._yaw, self._since_us = "climb", (n, e, z), flight.state.yaw, None
        self._z = self._goal[2] - return_height(flight, distance, self._goal[2] - z)

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        if flight.landed:
            return IDLE  # a vehicle that stands on the ground does not take off to return
        state, goal, p = flight.state, self._goal, flight.parameters
        n, e, z = state.position_ned
        distance = math.hypot(goal[0] - n, goal[1] - e)
        if self._leg == "climb" and z - self._z < RETURN_ARRIVED_M:
            self._leg = "cruise"
            if distance > 2.0:
                self._yaw = math.atan2(goal[1] - e, goal[0] - n)
        if self._leg == "cruise" and distance < RETURN_ARRIVED_M:
            self._leg = "wait" if p["RTL_LAND_DELAY"] else "land"
            self._z = max(self._z, goal[2] - float(p["RTL_DESCEND_ALT"]))
            self._land.enter(flight, goal)
        if self._leg == "wait":
            self._wait(flight)
        if self._leg == "land":
            return self._land.setpoint(flight)
        place = self._start if self._leg == "climb" else goal
        return cruising(flight, (place[0], place[1], self._z), self._yaw, distance)

    def _wait(self, flight: FlightContext) -> None:
        now, delay = flight.state.time_us, float(flight.parameters["RTL_LAND_DELAY"])
        if abs(flight.state.position_ned[2] - self._z) > RETURN_ARRIVED_M:
            return
        if self._since_us is None:
            self._since_us = now
        if 0.0 <= delay <= (now - self._since_us) * 1e-6:
            self._leg = "land"


TARGET_TIMEOUT_US = 3_000_000  # if no FOLLOW_TARGET arrives for longer, the vehicle holds its position
COURSE_SPEED = 1.0  # m/s; the course of a slower target is not updated
HEIGHT_LEAST = 1.0  # m; a lower FLW_TGT_HT counts as this height
CONSTANT, TERRAIN, TARGET = range(3)  # FLW_TGT_ALT_M


class Follow(Mode):
    """FOLLOW: flies beside a moving target. The vehicle holds its position while no FOLLOW_TARGET arrives."""

    def __init__(self) -> None:
        self._place: Vec3 = (0.0, 0.0, 0.0)
        self._yaw = 0.0
        self._course = math.nan  # rad, course of the target
        self._seen: Vec3 | None = None  # m, filtered position of the target
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
        return cruising(flight, self._place, self._yaw, distance)._replace(
            velocity_ned=(velocity[0], velocity[1], 0.0),
            speed_limit_horizontal=approach_speed(distance, speed, float(p["MPC_ACC_HOR"])) + math.hypot(*velocity),
        )

    def _track(self, flight: FlightContext, dt: float) -> None:
        """Extrapolate the target's position to now, and filter it with the time constant FLW_TGT_RS (s)."""
        target, age = flight.target, (flight.state.time_us - flight.target.time_us) * 1e-6
        vn, ve, vd = target.velocity_ned
        now = (
            target.position_ned[0] + vn * age, target.position_ned[1] + ve * age, target.position_ned[2] + vd * age
        )  # fmt: skip
        if self._seen is None:
            self._seen = now
            # a target at rest has no course: keep the vehicle on its present side of the target
            here, angle = flight.state.position_ned, math.radians(flight.parameters["FLW_TGT_FA"])
            self._course = math.atan2(here[1] - now[1], here[0] - now[0]) - angle
        share = dt / (max(float(flight.parameters["FLW_TGT_RS"]), 0.0) + dt) if dt > 0.0 else 0.0
        s = self._seen
        self._seen = (s[0] + share * (now[0] - s[0]), s[1] + share * (now[1] - s[1]), s[2] + share * (now[2] - s[2]))
        if math.hypot(vn, ve) > COURSE_SPEED:
            self._course = math.atan2(ve, vn)

    def _wanted(self, flight: FlightContext) -> Vec3:
        p = flight.parameters
        assert self._seen is not None
        bearing = self._course + math.radians(p["FLW_TGT_FA"])  # FLW_TGT_FA: 0° ahead of the target, 180° behind
        distance, height = float(p["FLW_TGT_DST"]), max(float(p["FLW_TGT_HT"]), HEIGHT_LEAST)
        reference = p["FLW_TGT_ALT_M"]
        ground = flight.home.position_ned[2] if flight.home is not None else 0.0
        if reference == TARGET and math.isfinite(self._seen[2]):
            ground = min(self._seen[2], ground)  # never lower than FLW_TGT_HT above home
        elif reference == TERRAIN and math.isfinite(flight.state.range_m()):
            ground = flight.state.position_ned[2] + flight.state.range_m()
        return (
            self._seen[0] + distance * math.cos(bearing),
            self._seen[1] + distance * math.sin(bearing),
            ground - height,
        )


CAPTURE_GAIN = 0.8  # radial speed (m/s) per distance (m) from the circle
LEAD_S = 0.4  # s, lag of the velocity behind its setpoint; measured with the x500 on circles of 8 to 40 m
ACCELERATION = 2.0  # m/s², largest centripetal acceleration: PX4's FlightTaskOrbit
RADIUS_LEAST = 1.0  # m
SPEED_MOST = 10.0  # m/s
STICK_RADIUS_RATE = 2.0  # m/s at full deflection of pitch
STICK_SPEED_RATE = 1.0  # m/s² at full deflection of roll
TO_CENTRE, INITIAL, FREE_YAW, ALONG, BY_STICK = range(5)  # ORBIT_YAW_BEHAVIOUR


def speed_limit(radius: float) -> float:
    """Return the greatest speed (m/s) on a circle of this radius (m)."""
    return min(SPEED_MOST, math.sqrt(ACCELERATION * radius))


class Orbit(Mode):
    """ORBIT: flies a circle, clockwise for a positive radius, counter-clockwise for a negative one."""

    def __init__(self) -> None:
        self.centre: Vec3 | None = None
        self.radius = 10.0  # m, > 0
        self.speed = 2.0  # m/s, signed: positive clockwise
        self.yaw_behaviour = TO_CENTRE
        self._yaw = 0.0
        self._time_us = 0

    def around(self, centre_ned: Vec3 | None, radius: float, speed: float, yaw_behaviour: int = TO_CENTRE) -> None:
        """Set the circle. A centre of None is the position at which the mode is entered.

        The sign of `radius` (m) gives the direction: positive is clockwise. The sign of `speed` (m/s) is ignored, and
        its size is limited to `speed_limit`.
        """
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
        # The setpoint is the velocity that will be right after LEAD_S. The velocity smoothing adds the feed-forward of
        # the acceleration. A second feed-forward in this setpoint would pull the vehicle inside the circle.
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
        """Return (yaw, yaw rate) of the requested behaviour. Far from the circle, ALONG looks at the centre."""
        if self.yaw_behaviour == INITIAL:
            return self._yaw, 0.0
        if self.yaw_behaviour == FREE_YAW:
            return math.nan, 0.0
        if self.yaw_behaviour == BY_STICK:
            return math.nan, stick_turn(flight)
        if self.yaw_behaviour == ALONG and on_circle:
            return wrap_pi(inwards - math.copysign(0.5 * math.pi, self.speed)), turn
        return inwards, turn

    def _listen(self, flight: FlightContext) -> None:
        """Change the circle by the sticks: pitch changes the radius, roll the speed."""
        dt = min((flight.state.time_us - self._time_us) * 1e-6, 0.1)
        self._time_us = flight.state.time_us
        p, sticks = flight.parameters, flight.sticks
        if not sticks.fresh(self._time_us, p["COM_RC_LOSS_T"]):
            return
        inwards = shaped(sticks.forward, p, "MPC_XY_MAN_EXPO")
        self.radius -= inwards * STICK_RADIUS_RATE * dt
        self.radius = max(min(self.radius, float(p["MC_ORBIT_RAD_MAX"])), RADIUS_LEAST)
        most = speed_limit(self.radius)
        # a vehicle that looks at the centre and moves to its right circles counter-clockwise
        self.speed = min(
            max(self.speed - shaped(sticks.right, p, "MPC_XY_MAN_EXPO") * STICK_SPEED_RATE * dt, -most), most
        )
