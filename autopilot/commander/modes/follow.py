"""FOLLOW: keep a place relative to a moving target (FOLLOW_TARGET), nose towards it. PX4's FLW_TGT_* parameters."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.setpoint import CascadeSetpoint
from autopilot.commander.modes.travel import approach_speed
from foundation.frames import Vec3

TARGET_TIMEOUT_US = 3_000_000  # a target that has been silent for longer is waited for on the spot
COURSE_SPEED = 1.0  # m/s, a slower target keeps the course it had
HEIGHT_LEAST = 1.0  # m, whatever FLW_TGT_HT says
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
