"""RETURN: climb, fly home, land there. PX4's RTL_TYPE 0 without rally points."""

import math

from autopilot.modes.flight import Flight, Home, Mode
from autopilot.modes.land import Land
from autopilot.modes.setpoint import IDLE, Setpoint
from autopilot.modes.travel import approach_speed
from dronecats.border.frames import Vec3

ARRIVED_M = 1.0


def return_height(flight: Flight, distance: float, height: float) -> float:
    """Return the height above home (m) to fly home at, from the horizontal distance and the present height (m).

    RTL_RETURN_ALT, lowered inside the cone of half-angle RTL_CONE_ANG over home, and never below the present height.
    """
    p = flight.parameters
    if distance < p["RTL_MIN_DIST"]:
        return height
    wanted = float(p["RTL_RETURN_ALT"])
    cone = float(p["RTL_CONE_ANG"])
    if 0.0 < cone < 90.0:
        wanted = min(wanted, distance / math.tan(math.radians(cone)))
    return max(wanted, height)


class ReturnHome(Mode):
    """Three legs: climb on the spot, cruise, land."""

    def __init__(self) -> None:
        self._leg = "climb"
        self._start: Vec3 = (0.0, 0.0, 0.0)
        self._z = 0.0
        self._yaw = 0.0
        self._land = Land()

    def enter(self, flight: Flight) -> None:
        n, e, z = flight.state.position_ned
        home = self._home(flight)
        distance = math.hypot(home[0] - n, home[1] - e)
        self._leg, self._start, self._yaw = "climb", (n, e, z), flight.state.yaw
        self._z = home[2] - return_height(flight, distance, home[2] - z)

    @staticmethod
    def _home(flight: Flight) -> Vec3:
        home: Home | None = flight.home
        return home.position_ned if home is not None else flight.state.position_ned

    def setpoint(self, flight: Flight) -> Setpoint:
        if flight.landed:
            return IDLE  # a vehicle that stands on the ground does not take off to return
        state, home, p = flight.state, self._home(flight), flight.parameters
        n, e, z = state.position_ned
        distance = math.hypot(home[0] - n, home[1] - e)
        if self._leg == "climb" and z - self._z < ARRIVED_M:
            self._leg = "cruise"
            if distance > 2.0:
                self._yaw = math.atan2(home[1] - e, home[0] - n)
        if self._leg == "cruise" and distance < ARRIVED_M:
            self._leg = "land"
            self._land.enter(flight)
            self._land.over(home)
        if self._leg == "land":
            return self._land.setpoint(flight)
        place = self._start if self._leg == "climb" else home
        return Setpoint(
            position_ned=(place[0], place[1], self._z),
            yaw=self._yaw,
            speed_limit_up=float(p["MPC_Z_V_AUTO_UP"]),
            speed_limit_down=float(p["MPC_Z_V_AUTO_DN"]),
            speed_limit_horizontal=approach_speed(distance, flight.cruise(), float(p["MPC_ACC_HOR"])),
        )
