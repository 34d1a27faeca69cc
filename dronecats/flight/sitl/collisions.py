"""Simulates collisions of drones with the moving target and with each other, and reports all hits."""

import itertools
from collections.abc import Callable, Sequence

from foundation.frames import Vec3, wrap_pi
from foundation.mavlink import dialect
from foundation.record_reader import reader
from foundation.truth import HitReport, clear_text, hit_text
from vehicles.collision import BOX
from vehicles.encounter import DRONE, balls, push_apart
from vehicles.multirotor import Multirotor

APART_US = 500_000  # µs without a touch after which a contact ends
LASTING_US = 500_000  # µs after which a contact is reported even if it began too slowly to count as a hit
UPDATE_US = 50_000  # µs, period of updates of the target's pose
AHEAD_S = 0.05  # s, time step for the finite difference of the target's velocity


class Traffic:
    """Updates the pose of the moving target in the vehicles' physics."""

    def __init__(self, pose: Callable[[float], tuple[Vec3, float]]) -> None:
        """`pose` returns (position_ned m, yaw rad) of the target, without tilt, at a time (s of the episode)."""
        self._pose = pose
        self._t0_us: int | None = None
        self._next_us = 0

    def begin(self, t0_us: int) -> None:
        """Start the motion of the target at this vehicle time. Until then, the physics has no target."""
        self._t0_us = t0_us

    def place(self, vehicles: Sequence[Multirotor], time_us: int) -> None:
        """Update the target's pose and velocity in every vehicle. Between updates the physics extrapolates them."""
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
    """Computes the contact forces between the vehicles of a fleet."""

    def __init__(self, vehicles: Sequence[Multirotor]) -> None:
        self._pairs = tuple(itertools.combinations(range(len(vehicles)), 2))
        self._balls = balls(vehicles)
        self._pushed: set[int] = set()
        self._vehicles = vehicles

    def part(self, tick_s: float) -> None:
        """Set the contact forces of touching vehicles for the coming tick, and clear the forces of the last tick."""
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
    """Reports the hits of a vehicle, its lasting contacts, and the ends of contacts."""

    def __init__(self, vehicle: Multirotor) -> None:
        self._vehicle = vehicle
        self._signs = reader(vehicle.state, "time_us", "crashed", "hits")
        self._touches = reader(vehicle.near, "newest_us", "leant_us")
        self._hits, self._crashed = 0, False
        self._since_us: int | None = None  # start of the current contact; None: no contact
        self._last_us = 0  # time of the last touch
        self._reported: set[str] = set()  # names of the things reported for the current contact

    def message(self) -> dialect.MAVLink_message | None:
        """Return a STATUSTEXT (`foundation.truth`) about a new event since the last call; None: no new event.

        Within one contact, each thing is reported once: when the vehicle hits it, or has leaned on it for LASTING_US.
        A contact ends after APART_US without a touch. Standing on something is not a contact.
        """
        time_us, crashed, hits = self._signs()
        touched_us, leant_us = self._touches()
        same = hits == self._hits and crashed == self._crashed and touched_us <= self._last_us
        if same and self._since_us is None:
            return None  # nothing new
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
        """Return a new hit, or a contact that has lasted long enough to be reported; None: neither."""
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
