"""Prepares a map for the episode search: free places, obstacles, quick checks of starts, and stretches of lanes.

A lane is a route for targets. A stretch of it is a path that stays on the ground between its waypoints.
"""

import itertools
import math
import random
from collections.abc import Iterator, Sequence
from functools import lru_cache

from episodes import maps
from episodes.authoring.check.finding import ALTITUDE_M, BODY_M
from episodes.authoring.check.placement import StaticObstacles
from episodes.authoring.check.sight import CAMERA, Framing, box_corners, framing, level
from episodes.maps import assets
from episodes.maps.scene import Instance, Places
from episodes.records.record import StartPose, TargetRecord
from episodes.world import world
from episodes.world.obstacles import REACH_M
from episodes.world.target import motion, on_line
from episodes.world.visibility import SolidsExcept, TargetView
from foundation.camera import camera_pose
from foundation.frames import Vec3
from foundation.terrain import HeightField

LEG_M = 4.0  # longest leg of a path
SHORTEST_M = 0.2  # shortest leg of a path
OFF_M = 0.012  # a path is at most this far from the ground, before heights are rounded
LOOK_M = 0.1  # distance between the points at which OFF_M is checked

ALTITUDES_M = (ALTITUDE_M[0] + 0.02, ALTITUDE_M[1] - 0.02)  # range of start heights: the rule's range, less a margin
EDGE_M = 3.0  # least distance from the edge of the terrain
DIRECTIONS = 36  # number of directions tried around a target
CLEAR_FRACTION = 0.8  # at least this share of the target is visible when the drone faces it; the rules demand less


def stretch(waypoints: Sequence[Vec3], first_m: float, length_m: float, terrain: HeightField) -> tuple[Vec3, ...]:
    """Return waypoints (m, NED, rounded to mm) along the part of a polyline from `first_m` to `first_m + length_m`."""
    flat = [(p[0], p[1]) for p in waypoints]
    marks = [0.0, *itertools.accumulate(math.dist(a, b) for a, b in itertools.pairwise(flat))]
    last_m = min(first_m + length_m, marks[-1])
    stops = [first_m, *(m for m in marks if first_m + SHORTEST_M < m < last_m - SHORTEST_M), last_m]
    points = [_along(flat, marks, s) for s in stops]
    path = [points[0]]
    for a, b in itertools.pairwise(points):
        legs = max(1, math.ceil(math.dist(a, b) / LEG_M))
        ends = [(a[0] + (b[0] - a[0]) * k / legs, a[1] + (b[1] - a[1]) * k / legs) for k in range(1, legs + 1)]
        for end in ends:
            path += _split(path[-1], end, terrain)
    return tuple((round(n, 3), round(e, 3), round(terrain.at(n, e), 3)) for n, e in path)


def _along(flat: list[tuple[float, float]], marks: list[float], s: float) -> tuple[float, float]:
    k = max(0, min(len(flat) - 2, next((i for i, m in enumerate(marks) if m > s), len(marks)) - 1))
    u = (s - marks[k]) / (marks[k + 1] - marks[k])
    return (flat[k][0] + u * (flat[k + 1][0] - flat[k][0]), flat[k][1] + u * (flat[k + 1][1] - flat[k][1]))


def _split(a: tuple[float, float], b: tuple[float, float], terrain: HeightField) -> list[tuple[float, float]]:
    """Return points after `a`, up to `b`, such that straight lines between them stay on the ground."""
    span = math.dist(a, b)
    low, high = terrain.at(*a), terrain.at(*b)
    steps = max(2, math.ceil(span / LOOK_M))
    worst, where = 0.0, 0.5
    for k in range(1, steps):
        u = k / steps
        off = abs(low + u * (high - low) - terrain.at(a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])))
        if off > worst:
            worst, where = off, u
    if worst <= OFF_M or span < 2 * SHORTEST_M:
        return [b]
    where = min(max(where, SHORTEST_M / span), 1.0 - SHORTEST_M / span)
    middle = (a[0] + where * (b[0] - a[0]), a[1] + where * (b[1] - a[1]))
    return [*_split(a, middle, terrain), *_split(middle, b, terrain)]


class Site:
    """One map with one seed."""

    def __init__(self, name: str, seed: int) -> None:
        """Build the map. Raises UsageError if the map does not exist or has no list of places."""
        self.places: Places = maps.places(name, seed)
        self.name, self.seed = name, seed
        self.scene = maps.build(name, seed)
        self.solids = world.solids(name, seed)
        self.obstacles = StaticObstacles(self.scene.instances)
        self._view = lru_cache(maxsize=128)(self._view_of)  # instances are compared by identity

    def free_paints(self) -> list[str]:
        """Return the paints that no asset on this map has, in the order of `assets.PAINTS`."""
        kinds = set(assets.names())
        worn = {m.name for i in self.scene.instances if i.kind in kinds for m in i.mesh.materials}
        return [paint for paint in assets.PAINTS if f"paint-{paint}" not in worn]

    def placed(self, target: TargetRecord) -> Instance:
        """Return the instance of a record's target at its start: the map's own if it is native, else a level one."""
        if target.native is not None:
            return next(i for i in self.scene.instances if i.name == target.native)
        if target.paint is None:
            raise ValueError("a placed target needs a paint")
        mesh = assets.build(target.asset, target.paint, target.inscription)
        return Instance(1, "target", target.asset, mesh, *motion(target).pose(0.0))

    def _view_of(self, target: Instance) -> TargetView:
        is_native = target in self.scene.instances
        return TargetView(target.mesh, SolidsExcept(self.solids, target) if is_native else self.solids)

    def ground(self, north: float, east: float) -> float:
        """Return the NED z (m) of the ground."""
        return self.scene.terrain.at(north, east)

    def on_map(self, north: float, east: float) -> bool:
        """Return whether a point is at least EDGE_M inside the terrain."""
        field = self.scene.terrain
        rows, columns = field.down.shape
        high_n = field.origin_north + (rows - 1) * field.cell_m - EDGE_M
        high_e = field.origin_east + (columns - 1) * field.cell_m - EDGE_M
        on: bool = field.origin_north + EDGE_M <= north <= high_n and field.origin_east + EDGE_M <= east <= high_e
        return on

    def free(self, place: Vec3) -> bool:
        """Return whether a drone has room at a place (m) and below it."""
        north, east, down = place
        ground = self.ground(north, east)
        heights = [down + k * (ground - down) / 6 for k in range(6)]
        return all(not self.obstacles.nearest((north, east, z), REACH_M + 0.05)[1] for z in heights)

    def framed(self, target: Instance, place: Vec3) -> Framing:
        """Return the framing of a target for a drone that turns at a place."""
        return framing(box_corners(target.mesh, target.position_ned, target.yaw), place)

    def starts(
        self, target: Instance, distance_m: float, height_m: float, rng: random.Random, off_axes_deg: float = 0.0
    ) -> Iterator[Vec3]:
        """Yield places (m) at a 3-D distance from a target, with a good view of the target and a clear way to it.

        The bearing of the target is more than `off_axes_deg` off the map's axes.
        """
        goal = target.centre_ned
        turns = [360.0 * (k + rng.random()) / DIRECTIONS for k in range(DIRECTIONS)]
        rng.shuffle(turns)
        for angle in turns:
            if off_axes_deg and abs(math.remainder(angle, 90.0)) < off_axes_deg + 0.5:
                continue
            place = self._at(goal, distance_m, math.radians(angle), height_m)
            if not self.on_map(place[0], place[1]) or not self.free(place):
                continue
            if self.seen(target, place, angle) >= CLEAR_FRACTION and self.clear(place, goal):
                yield place

    def seen(self, target: Instance, place: Vec3, yaw_deg: float) -> float:
        """Return the fraction (0 … 1) of a target that a level drone at a place sees."""
        pose = camera_pose(place, level(yaw_deg), CAMERA)
        return self._view(target).sight(target.position_ned, target.yaw, pose, CAMERA).fraction

    def _at(self, goal: Vec3, distance_m: float, bearing: float, height_m: float) -> Vec3:
        """Return the place `height_m` above the ground from which a goal has a bearing (rad) and a 3-D distance."""
        down, flat = goal[2], distance_m
        for _ in range(4):
            north, east = goal[0] - flat * math.cos(bearing), goal[1] - flat * math.sin(bearing)
            down = self.ground(north, east) - height_m
            flat = math.sqrt(max(distance_m**2 - (goal[2] - down) ** 2, 1.0))
        return rounded((goal[0] - flat * math.cos(bearing), goal[1] - flat * math.sin(bearing), down))

    def clear(self, place: Vec3, goal: Vec3) -> bool:
        """Return whether the straight way from a place to 5 m before a goal is clear.

        The rule `sight.way_to_target` checks more points.
        """
        span = math.dist(place, goal)
        for k in range(1, int((span - 5.0) / 1.5) + 1):
            point = on_line(place, goal, k * 1.5 / span)
            is_low = self.ground(point[0], point[1]) - point[2] < BODY_M + 0.02
            if is_low or self.obstacles.nearest(point, BODY_M + 0.05)[1]:
                return False
        return True


def start(place: Vec3, yaw_deg: float) -> StartPose:
    """Return a start with its yaw rounded to 0.1°, -180 … 180."""
    return StartPose(place, round(math.remainder(yaw_deg, 360.0), 1))


def rounded(place: Vec3) -> Vec3:
    """Return a place (m) rounded to millimetres."""
    return (round(place[0], 3), round(place[1], 3), round(place[2], 3))
