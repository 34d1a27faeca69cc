"""ORBIT: circle a point at constant radius and speed (MAV_CMD_DO_ORBIT); the sticks change radius and speed."""

import math

from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.setpoint import CascadeSetpoint
from autopilot.commander.modes.sticks import shaped
from foundation.frames import Vec3, wrap_pi

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
