"""RETURN: climb, fly to the nearest of home and the rally points, land there. PX4's RTL_TYPE 0."""

import math

from autopilot.commander.home import Home
from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.modes.land import Land
from autopilot.commander.modes.setpoint import IDLE, CascadeSetpoint
from autopilot.commander.modes.travel import approach_speed
from autopilot.commander.plan.items import local_place
from foundation.frames import Vec3

ARRIVED_M = 1.0


def return_height(flight: FlightContext, distance: float, height: float) -> float:
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


def safe_places(flight: FlightContext) -> list[Vec3]:
    """Return where the vehicle may land: home first, then the rally points that say where they are (m, NED)."""
    home: Home | None = flight.home
    places = [home.position_ned if home is not None else flight.state.position_ned]
    for item in flight.plans.rally:
        place = local_place(item, flight.state, home)
        if all(math.isfinite(x) for x in place):
            places.append(place)
    return places


class ReturnHome(Mode):
    """Climb on the spot, cruise, descend to RTL_DESCEND_ALT and wait RTL_LAND_DELAY (negative: for ever), land."""

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
        if self._leg == "climb" and z - self._z < ARRIVED_M:
            self._leg = "cruise"
            if distance > 2.0:
                self._yaw = math.atan2(goal[1] - e, goal[0] - n)
        if self._leg == "cruise" and distance < ARRIVED_M:
            self._leg = "wait" if p["RTL_LAND_DELAY"] else "land"
            self._z = max(self._z, goal[2] - float(p["RTL_DESCEND_ALT"]))
            self._land.enter(flight)
            self._land.over(goal)
        if self._leg == "wait":
            self._wait(flight)
        if self._leg == "land":
            return self._land.setpoint(flight)
        place = self._start if self._leg == "climb" else goal
        return CascadeSetpoint(
            position_ned=(place[0], place[1], self._z),
            yaw=self._yaw,
            speed_limit_up=float(p["MPC_Z_V_AUTO_UP"]),
            speed_limit_down=float(p["MPC_Z_V_AUTO_DN"]),
            speed_limit_horizontal=approach_speed(distance, flight.cruise(), float(p["MPC_ACC_HOR"])),
        )

    def _wait(self, flight: FlightContext) -> None:
        now, delay = flight.state.time_us, float(flight.parameters["RTL_LAND_DELAY"])
        if abs(flight.state.position_ned[2] - self._z) > ARRIVED_M:
            return
        if self._since_us is None:
            self._since_us = now
        if 0.0 <= delay <= (now - self._since_us) * 1e-6:
            self._leg = "land"
