"""ORBIT: circle a point at constant radius and speed, nose to the centre (MAV_CMD_DO_ORBIT)."""

import math

from autopilot.modes.flight import Flight, Mode
from autopilot.modes.setpoint import Setpoint
from dronecats.border.frames import Vec3, wrap_pi

CAPTURE_GAIN = 0.8  # 1/s, radial error to radial speed


class Orbit(Mode):
    """Positive radius circles clockwise, negative counter-clockwise."""

    def __init__(self) -> None:
        self.centre: Vec3 | None = None
        self.radius = 10.0  # m, > 0
        self.speed = 2.0  # m/s, signed: positive clockwise

    def around(self, centre_ned: Vec3 | None, radius: float, speed: float) -> None:
        """Choose the circle for the next entry; None = a circle through the vehicle's own place ahead of it."""
        self.centre, self.radius = centre_ned, max(abs(radius), 1.0)
        self.speed = math.copysign(abs(speed), radius)

    def enter(self, flight: Flight) -> None:
        if self.centre is None:
            self.centre = flight.state.position_ned

    def setpoint(self, flight: Flight) -> Setpoint:
        centre = self.centre or flight.state.position_ned
        n, e, _ = flight.state.position_ned
        dn, de = n - centre[0], e - centre[1]
        distance = math.hypot(dn, de)
        un, ue = (dn / distance, de / distance) if distance > 0.1 else (1.0, 0.0)
        radial = max(-abs(self.speed) - 2.0, min(abs(self.speed) + 2.0, CAPTURE_GAIN * (self.radius - distance)))
        tangential = self.speed if abs(distance - self.radius) < max(2.0, 0.3 * self.radius) else 0.0
        centripetal = tangential * tangential / max(distance, 1.0)
        return Setpoint(
            position_ned=(math.nan, math.nan, centre[2]),
            velocity_ned=(un * radial - ue * tangential, ue * radial + un * tangential, math.nan),
            acceleration_ned=(-un * centripetal, -ue * centripetal, math.nan),
            yaw=wrap_pi(math.atan2(-ue, -un)),
            yaw_rate=tangential / max(distance, 1.0),
            speed_limit_up=float(flight.parameters["MPC_Z_V_AUTO_UP"]),
            speed_limit_down=float(flight.parameters["MPC_Z_V_AUTO_DN"]),
        )
