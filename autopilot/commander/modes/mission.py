"""MISSION: flies the uploaded items one after the other, as PX4 does with a multicopter."""

import math

from autopilot.commander import plans
from autopilot.commander.modes.automatic import Land, cruising
from autopilot.commander.modes.flight import FlightContext, Mode
from autopilot.commander.plans import PlanItem, local_place
from autopilot.records import CascadeSetpoint
from foundation.frames import Vec3, wrap_pi

CLIMBED_M = 0.5  # a climb ends this far below its target
TURN_TO_COURSE_M = 3.0  # nearer to the waypoint, the vehicle keeps its heading
LAND_OVER_M = 1.0  # acceptance radius of LAND and LOITER


class Mission(Mode):
    """Flies the mission.

    `current` is the number of the item in progress, also while other modes fly. `reached` has the numbers of completed
    items that clients do not know yet.
    """

    def __init__(self) -> None:
        self.current = 0
        self.complete = False
        self.begun = False
        self.reached: list[int] = []
        self._jumps: dict[int, int] = {}  # item → jumps made
        self._leg = "fly"  # climb, fly, stay, hold, land
        self._start: Vec3 = (0.0, 0.0, 0.0)
        self._target: Vec3 = (0.0, 0.0, 0.0)
        self._climb_z = 0.0  # m, NED, target of "climb"
        self._yaw = 0.0
        self._forced_yaw = False
        self._since_us: int | None = None  # when the stay began
        self._land = Land()

    def rewind(self, item: int = 0) -> None:
        """Continue at `item` when the mode is next entered."""
        self.current, self.complete, self.begun = item, False, item > 0
        self._jumps.clear()

    def enter(self, flight: FlightContext) -> None:
        self.next_mode = None
        if self.complete or self.current >= len(flight.plans.mission):
            self.rewind()
        self.begun = True
        speeds = [i.p[1] for i in flight.plans.mission[: self.current] if i.command == plans.CHANGE_SPEED]
        if speeds:
            flight.change_speed(speeds[-1])
        self._target, self._yaw = flight.state.position_ned, flight.state.yaw
        self._seek(flight)

    def setpoint(self, flight: FlightContext) -> CascadeSetpoint:
        if not flight.plans.mission and self.next_mode is None:
            self._finish(flight.state.position_ned)
        elif self.next_mode is None:
            self._follow(flight)
        if self._leg == "land" and self.next_mode is None:
            return self._land.setpoint(flight)
        n, e, _ = flight.state.position_ned
        place = (self._start[0], self._start[1], self._climb_z) if self._leg == "climb" else self._target
        distance = math.hypot(place[0] - n, place[1] - e)
        setpoint = cruising(flight, place, self._yaw, distance)
        if self._leg == "climb" and flight.landed:
            return setpoint._replace(speed_limit_up=float(flight.parameters["MPC_TKO_SPEED"]))
        return setpoint

    # sequence of items

    def _seek(self, flight: FlightContext) -> None:
        """Execute the items that take no time, then begin the next item of `plans.NAVIGATION`."""
        items = flight.plans.mission
        for _ in range(2 * len(items) + 2):  # ends a loop of jumps without a waypoint
            if self.current >= len(items):
                break
            item = items[self.current]
            if item.command in plans.NAVIGATION:
                self._begin(flight, item)
                return
            following = self._carry_out(flight, item)
            self.reached.append(self.current)
            self.current = following
        self._finish(self._target)

    def _advance(self, flight: FlightContext) -> None:
        self.reached.append(self.current)
        if not flight.plans.mission[self.current].autocontinue:
            self._leg = "hold"  # until a client sets another item
            return
        self.current += 1
        self._seek(flight)

    def _finish(self, rest: Vec3, following: str = "HOLD") -> None:
        self.complete = True
        self.rest, self.next_mode = rest, following

    def _carry_out(self, flight: FlightContext, item: PlanItem) -> int:
        """Execute an item that takes no time; return the next item's number."""
        if item.command == plans.CHANGE_SPEED:
            flight.change_speed(item.p[1])
        elif item.command == plans.SET_HOME and flight.parameters["COM_HOME_EN"]:
            place = plans.local_place(item, flight.state, flight.home)
            is_given = item.p[0] != 1 and all(map(math.isfinite, place))
            flight.set_home(place if is_given else None)
        elif item.command == plans.JUMP:
            made = self._jumps.get(self.current, 0)
            if item.p[1] < 0 or made < item.p[1]:
                self._jumps[self.current] = made + 1
                return int(item.p[0])
            self._jumps.pop(self.current, None)
        return self.current + 1

    def _begin(self, flight: FlightContext, item: PlanItem) -> None:
        here = flight.state.position_ned
        self._since_us, self._start = None, here
        n, e, z = local_place(item, flight.state, flight.home)
        least = here[2] - float(flight.parameters["MIS_TAKEOFF_ALT"])
        if item.command == plans.DELAY:
            self._leg = "stay"
            return
        if item.command == plans.RETURN:
            self.reached.append(self.current)
            self.complete = self.current + 1 >= len(flight.plans.mission)
            self.current += not self.complete
            self.rest, self.next_mode = here, "RETURN"
            return
        if item.command == plans.LAND:
            z = here[2]  # fly over the place at the present height, then descend
        elif not math.isfinite(z):
            z = least if item.command == plans.TAKEOFF or flight.landed else here[2]
        self._target = (n, e, z) if math.isfinite(n) else (here[0], here[1], z)
        self._forced_yaw = abs(item.p[3]) < 1e4 and item.command != plans.LAND
        self._leg = "fly"
        if flight.landed and item.command == plans.TAKEOFF:
            self._target = (self._target[0], self._target[1], min(self._target[2], least))
        self._climb_z = self._target[2]
        if flight.landed and item.command != plans.LAND:
            # as on PX4, take off to the item's height, at least MIS_TAKEOFF_ALT, even if the item is no TAKEOFF
            self._climb_z = min(self._climb_z, least)
            self._leg = "climb"
        elif item.command == plans.TAKEOFF and here[2] - self._target[2] > CLIMBED_M:
            self._leg = "climb"
        if self._forced_yaw:
            self._yaw = wrap_pi(math.radians(item.p[3]))

    # within one item

    def _follow(self, flight: FlightContext) -> None:
        item = flight.plans.mission[self.current]
        n, e, z = flight.state.position_ned
        to_n, to_e, to_z = self._target
        distance = math.hypot(to_n - n, to_e - e)
        if self._leg == "climb":
            if z - self._climb_z < CLIMBED_M and not flight.landed:
                self._leg = "fly"
            return
        if self._leg == "land":
            if flight.landed and not self.complete:
                self.reached.append(self.current)
                self.complete = True  # items after a landing are not flown
            return
        if self._leg == "fly":
            if distance > TURN_TO_COURSE_M and not self._forced_yaw and flight.parameters["MPC_YAW_MODE"] == 0:
                self._yaw = math.atan2(to_e - e, to_n - n)
            if self._arrived(flight, item, distance, abs(to_z - z)):
                self._leg, self._since_us = "stay", flight.state.time_us
                if item.command == plans.LAND:
                    self._leg = "land"
                    self._land.enter(flight, self._target)
        if self._leg == "stay":
            self._stay(flight, item)

    def _arrived(self, flight: FlightContext, item: PlanItem, distance: float, height: float) -> bool:
        p = flight.parameters
        item_radius = item.p[1] if item.command == plans.WAYPOINT else math.nan
        radius = item_radius if 0.0 < item_radius < 1e4 else float(p["NAV_ACC_RAD"])
        if item.command in (plans.LAND, plans.LOITER, plans.LOITER_TIME):
            radius = LAND_OVER_M
        if distance > radius or height > float(p["NAV_MC_ALT_RAD"]):
            return False
        turned = abs(wrap_pi(self._yaw - flight.state.yaw)) < math.radians(p["MIS_YAW_ERR"])
        return turned or not self._forced_yaw

    def _stay(self, flight: FlightContext, item: PlanItem) -> None:
        now = flight.state.time_us
        if self._since_us is None:
            self._since_us = now
        wait = item.p[0] if item.command in (plans.WAYPOINT, plans.LOITER_TIME, plans.DELAY) else 0.0
        wait = math.inf if item.command == plans.LOITER else (wait if wait > 0.0 else 0.0)
        if (now - self._since_us) * 1e-6 >= wait:
            self._advance(flight)
