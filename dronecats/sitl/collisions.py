"""What a fleet can run into beside the standing map: the moving target and one another; and the word that it did."""

import itertools
from collections.abc import Callable, Sequence

from foundation.frames import Vec3, wrap_pi
from foundation.mavlink import dialect
from vehicles.collision import BOX
from vehicles.encounter import DRONE, ball, girth, meet
from vehicles.multirotor import Multirotor

SAID_AGAIN_US = 1_000_000  # µs, a vehicle that scrapes along a wall says so once a second
TOLD_US = 50_000  # µs
AHEAD_S = 0.05  # s, over which the target's velocity is taken


class Traffic:
    """Keeps the moving target where it is in the vehicles' physics."""

    def __init__(self, pose: Callable[[float], tuple[Vec3, float]]) -> None:
        """`pose` gives (position_ned m, yaw rad) at seconds since the episode began."""
        self._pose = pose
        self._t0_us: int | None = None
        self._next_us = 0

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves; before, nobody knows where it is and it is not there."""
        self._t0_us = t0_us

    def place(self, vehicles: Sequence[Multirotor]) -> None:
        """Tell every vehicle where the target is now and how it goes on; between two words it goes straight on."""
        time_us = int(vehicles[0].state["time_us"])
        if self._t0_us is None or time_us < self._next_us:
            return
        self._next_us = time_us + TOLD_US
        for vehicle in vehicles:
            t_s = (time_us - self._t0_us) / 1e6
            here, yaw = self._pose(t_s)
            soon, later = self._pose(t_s + AHEAD_S)
            north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
            vehicle.meet_box(here, yaw, (north, east, down), wrap_pi(later - yaw) / AHEAD_S)


class Encounters:
    """Lets the vehicles of a fleet push one another away."""

    def __init__(self, vehicles: Sequence[Multirotor]) -> None:
        self._pairs = tuple(itertools.combinations(range(len(vehicles)), 2))
        self._radii_m = tuple(girth(vehicle) for vehicle in vehicles)
        self._pushed: set[int] = set()
        self._vehicles = vehicles

    def part(self, tick_s: float) -> None:
        """Set the forces of those who touch for the coming tick, and take back those of the last."""
        for k in self._pushed:
            self._vehicles[k].state["external_force"] = self._vehicles[k].state["external_torque"] = 0.0
        self._pushed.clear()
        if not self._pairs:
            return
        balls = [ball(vehicle, radius_m) for vehicle, radius_m in zip(self._vehicles, self._radii_m, strict=True)]
        for i, j in self._pairs:
            if balls[i].may_touch(balls[j], tick_s) and meet(self._vehicles[i], self._vehicles[j], tick_s):
                self._pushed |= {i, j}


class CollisionReport:
    """Puts into words what a vehicle ran into."""

    def __init__(self, vehicle: Multirotor) -> None:
        self._vehicle = vehicle
        self._hits, self._crashed, self._silent_until_us = 0, False, 0

    def message(self) -> dialect.MAVLink_message | None:
        """Return a STATUSTEXT when something was hit since the last one, or the vehicle crashed; None otherwise."""
        state = self._vehicle.state
        hits, crashed = int(state["hits"]), bool(state["crashed"])
        time_us = int(state["time_us"])
        newly = crashed and not self._crashed
        if not newly and (hits == self._hits or time_us < self._silent_until_us):
            return None
        struck = hits > self._hits
        self._hits, self._crashed, self._silent_until_us = hits, crashed, time_us + SAID_AGAIN_US
        what = f"{self._name(int(state['hit_owner']))} at {state['hit_speed']:.1f} m/s" if struck else "the ground"
        severity = dialect.MAV_SEVERITY_CRITICAL if newly else dialect.MAV_SEVERITY_WARNING
        text = f"{'Crash' if newly else 'Collision'}: hit {what}"
        return dialect.MAVLink_statustext_message(severity, text.encode()[:50], 0, 0)

    def _name(self, owner: int) -> str:
        obstacles = self._vehicle.obstacles
        if owner == BOX and obstacles.moving:
            return obstacles.moving.name
        return "another drone" if owner == DRONE else obstacles.names[owner]
