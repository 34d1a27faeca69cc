"""Collisions of a fleet with the moving target and with one another, and the reports of all hits."""

import itertools
from collections.abc import Callable, Sequence

from foundation.frames import Vec3, wrap_pi
from foundation.mavlink import dialect
from foundation.record_reader import reader
from foundation.truth import HitReport, clear_text, hit_text
from vehicles.collision import BOX
from vehicles.encounter import DRONE, balls, push_apart
from vehicles.multirotor import Multirotor

APART_US = 500_000  # µs without any contact after which a contact is over
LASTING_US = 500_000  # µs from which on a contact counts that began too slowly to be a hit
UPDATE_US = 50_000  # µs
AHEAD_S = 0.05  # s, over which the target's velocity is taken


class Traffic:
    """Keeps the moving target where it is in the vehicles' physics."""

    def __init__(self, pose: Callable[[float], tuple[Vec3, float]]) -> None:
        """`pose` gives (position_ned m, yaw rad), as if it stood level, at seconds since the episode began."""
        self._pose = pose
        self._t0_us: int | None = None
        self._next_us = 0

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves; before, it is not there."""
        self._t0_us = t0_us

    def place(self, vehicles: Sequence[Multirotor], time_us: int) -> None:
        """Tell every vehicle where the target is now and how it goes on; between two words it goes straight on."""
        if self._t0_us is None or time_us < self._next_us:
            return
        self._next_us = time_us + UPDATE_US
        for vehicle in vehicles:
            t_s = (time_us - self._t0_us) / 1e6
            here, yaw = self._pose(t_s)
            soon, later = self._pose(t_s + AHEAD_S)
            north, east, down = ((b - a) / AHEAD_S for a, b in zip(here, soon, strict=True))
            vehicle.place_box(here, yaw, (north, east, down), wrap_pi(later - yaw) / AHEAD_S)


class Encounters:
    """Lets the vehicles of a fleet push one another away."""

    def __init__(self, vehicles: Sequence[Multirotor]) -> None:
        self._pairs = tuple(itertools.combinations(range(len(vehicles)), 2))
        self._balls = balls(vehicles)
        self._pushed: set[int] = set()
        self._vehicles = vehicles

    def part(self, tick_s: float) -> None:
        """Set the forces of those who touch for the coming tick, and take back those of the last."""
        for k in self._pushed:
            self._vehicles[k].state["external_force"] = self._vehicles[k].state["external_torque"] = 0.0
        self._pushed.clear()
        if not self._pairs:
            return
        now = self._balls()
        for i, j in self._pairs:
            if now[i].may_touch(now[j], tick_s) and push_apart(self._vehicles[i], self._vehicles[j], tick_s):
                self._pushed |= {i, j}


class CollisionReport:
    """Puts into words what a vehicle ran into or leans on, and when it was free again."""

    def __init__(self, vehicle: Multirotor) -> None:
        self._vehicle = vehicle
        self._signs = reader(vehicle.state, "time_us", "crashed", "hits")
        self._touches = reader(vehicle.near, "newest_us", "leant_us")
        self._hits, self._crashed = 0, False
        self._since_us: int | None = None  # when the present contact began
        self._last_us = 0  # when anything touched last
        self._reported: set[str] = set()  # what the present contact is known to be with

    def message(self) -> dialect.MAVLink_message | None:
        """Return a STATUSTEXT (`foundation.truth`) about what is new since the last call, None for nothing.

        Each thing that one contact hits, or leans on for LASTING_US, is reported once. The contact ends after half a
        second without a touch. Standing on something is no contact.
        """
        time_us, crashed, hits = self._signs()
        touched_us, leant_us = self._touches()
        same = hits == self._hits and crashed == self._crashed and touched_us <= self._last_us
        if same and self._since_us is None:
            return None  # as at nearly every tick
        struck, newly = hits > self._hits, crashed and not self._crashed
        self._hits, self._crashed = hits, crashed
        leans = leant_us > self._last_us
        if struck or touched_us > self._last_us:
            self._last_us = time_us if struck else touched_us
        if self._since_us is None and (struck or leans):
            self._since_us = self._last_us
        hit = self._hit(struck, newly, leans)
        if hit is not None and (newly or hit.what not in self._reported):
            if self._since_us is not None:
                self._reported.add(hit.what)
            severity = dialect.MAV_SEVERITY_CRITICAL if newly else dialect.MAV_SEVERITY_WARNING
            return _text(severity, hit_text(hit))
        if self._since_us is not None and time_us - self._last_us > APART_US:
            seconds, known = (self._last_us - self._since_us) / 1e6, bool(self._reported)
            self._since_us = None
            self._reported.clear()
            return _text(dialect.MAV_SEVERITY_INFO, clear_text(seconds)) if known else None
        return None

    def _hit(self, struck: bool, crashed: bool, leans: bool) -> HitReport | None:
        """Return what the vehicle has run into, or what it has leant on for so long that it counts as a hit."""
        state, near = self._vehicle.state, self._vehicle.near
        if struck:
            return HitReport(self._name(int(state["hit_owner"])), float(state["hit_speed"]), crashed)
        if crashed:
            return HitReport("the ground", None, True)
        if leans and self._since_us is not None and self._last_us - self._since_us >= LASTING_US:
            return HitReport(self._name(int(near["leant_on"])), max(float(near["leant_speed"]), 0.0), False)
        return None

    def _name(self, owner: int) -> str:
        obstacles = self._vehicle.obstacles
        if owner == BOX and obstacles.moving:
            return obstacles.moving.name
        return "another drone" if owner == DRONE else obstacles.names[owner]


def _text(severity: int, text: str) -> dialect.MAVLink_message:
    return dialect.MAVLink_statustext_message(severity, text.encode(), 0, 0)
