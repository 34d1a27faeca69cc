"""Rules about the target's place and path, and about the starts of the drones.

The target must stand on the ground and touch no obstacle. A moving target must move for the whole episode. The drones
must start at the recorded distance, at an allowed height, and with room to take off. Obstacles are the static solids
of the map, except the ground and leaves.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from episodes.authoring.check.finding import (
    BEARING_OFF_DEG,
    DEFAULT_RULES,
    DISTANCE_OFF_M,
    GRID_OFF_M,
    GRID_SIDE_M,
    LEVEL_M,
    OFF_GROUND_M,
    RULES,
    START_TO_PATH_M,
    WHEEL_OFF_M,
    RuleFinding,
    at_least,
    at_most,
    between,
)
from episodes.maps.scene import Array, Instance, Mesh, turn
from episodes.records.record import StartPose
from episodes.world.obstacles import REACH_M
from episodes.world.target import TargetMotion, contact_patch, has_wheels, motion
from episodes.world.visibility import HardSolids
from episodes.world.world import World
from foundation.frames import Vec3, bearing_deg
from foundation.protocol import CAP_S

GROUND_STEP_M = 0.1  # between checked points of a path
SWEEP_STEP_M = 0.25  # between checked poses of a moving target
MOST_SWEEPS = 1500  # upper limit of checked poses per path; on paths over 375 m they are more than SWEEP_STEP_M apart
MARGIN_M = 0.05  # a target on its path must be this far from every obstacle
LIFT_M = 0.12  # a target may pass over obstacles lower than this, such as kerbs and roots

CLIMB_STEP_M = 0.2  # between checked points of a climb
RIM = 16  # points around a start at which the ground is measured


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A box with vertical sides."""

    centre_ned: Array  # (3,) m
    half: Array  # (3,) m, half size along the box's own axes
    yaw: float  # rad


def box_of(mesh: Mesh, place: Vec3, yaw: float, margin_m: float = 0.0, lift_m: float = 0.0) -> Box:
    """Return the box around a mesh at a pose, with a margin. The box begins `lift_m` above the foot of the mesh."""
    low = mesh.vertices.min(axis=0).astype(np.float64) - margin_m
    high = mesh.vertices.max(axis=0).astype(np.float64) + margin_m
    high[2] = min(high[2], -lift_m)
    return Box(np.array(place) + turn(yaw) @ ((low + high) / 2), np.maximum((high - low) / 2, 0.01), yaw)


class StaticObstacles(HardSolids):
    """All static solids of a scene, except the ground and leaves."""

    def __init__(self, instances: Iterable[Instance]) -> None:
        super().__init__(i for i in instances if i.kind != "ground")
        self._triangles: dict[int, Array] = {}  # of the obstacles that `overlapping` has met, m NED

    def overlapping(self, box: Box, but: str = "") -> str:
        """Return the name of an obstacle whose surface overlaps the box, or ''. The obstacle named `but` is ignored."""
        reach = np.abs(turn(box.yaw)) @ box.half
        low, high = box.centre_ned - reach, box.centre_ned + reach
        near = (self._boxes[:, 0] <= high).all(axis=1) & (self._boxes[:, 1] >= low).all(axis=1)
        for k in map(int, np.flatnonzero(near)):
            if self._instances[k].name == but:
                continue
            if k not in self._triangles:
                self._triangles[k] = replace(self._instances[k], mesh=self._hard[k]).triangles_ned()
            if overlaps(self._triangles[k], box):
                return self._instances[k].name
        return ""


def overlaps(triangles: Array, box: Box) -> bool:
    """Return whether any of the triangles (T, 3, 3) in m NED overlaps a box.

    Source: Akenine-Möller, Fast 3D Triangle-Box Overlap Testing. The separating axes are the three axes of the box, the
    normal of the triangle, and the nine cross products of an axis and an edge of the triangle.
    """
    local = (triangles - box.centre_ned) @ turn(box.yaw)
    reach = (local.min(axis=1) <= box.half).all(axis=1) & (local.max(axis=1) >= -box.half).all(axis=1)
    local = local[reach]
    if len(local) == 0:
        return False
    edges = np.stack([local[:, 1] - local[:, 0], local[:, 2] - local[:, 1], local[:, 0] - local[:, 2]], axis=1)
    normal = np.cross(edges[:, 0], edges[:, 1])
    axes = np.concatenate([normal[:, None], *(np.cross(edges, np.eye(3)[k])[:, :] for k in range(3))], axis=1)
    along = np.einsum("tax,tcx->tac", axes, local)
    extent = np.einsum("tax,x->ta", np.abs(axes), box.half)
    apart = (along.min(axis=2) > extent) | (along.max(axis=2) < -extent)
    return bool((~apart.any(axis=1)).any())


def target_rules(world: World, obstacles: StaticObstacles) -> Iterator[RuleFinding]:
    """Yield the findings about the target's distance from the ground, the space around it, and its path.

    Yield nothing for a native target (an object of the map).
    """
    record = world.record
    if record.target.native is not None:
        return
    yield from wheels(world)
    if record.target.path is None:
        (north, east, down), yaw = motion(record.target).pose(0.0)  # the level pose; `wheels` checks the tilted pose
        off = abs(down - world.ground_down(north, east))
        yield at_most("the distance of the target's foot from the ground", off, OFF_GROUND_M, "m", 3)
        met = obstacles.overlapping(box_of(world.target.mesh, (north, east, down), yaw, 0.0, LIFT_M), "target")
        yield RuleFinding("the obstacle at the target's place", not met, met or "nothing", "nothing")
        return
    yield path_off_ground(world)
    yield path_clear(world, obstacles)
    yield path_length(world)
    yield from pace(world)
    here = record.starts[0].position_ned
    times = np.arange(0.0, CAP_S + 0.5, 1.0)
    nearest = min(math.dist(here, world.target_centre(float(t))) for t in times)
    yield at_least("the path's distance from the start", nearest, START_TO_PATH_M, "m")


def path_off_ground(world: World) -> RuleFinding:
    """Return whether the path lies on the ground, also between waypoints, up to where the target is after CAP_S."""
    path = world.record.target.path
    if path is None:
        raise ValueError("the target stands still")
    worst, where, gone = 0.0, path.waypoints_ned[0], 0.0
    for a, b in itertools.pairwise(path.waypoints_ned):
        leg = math.dist(a, b)
        for u in np.linspace(0.0, 1.0, max(2, math.ceil(leg / GROUND_STEP_M) + 1)):
            if gone + u * leg > path.speed_mps * CAP_S + MARGIN_M:
                break  # the target does not reach this point in an episode
            n, e, d = (float(p + u * (q - p)) for p, q in zip(a, b, strict=True))
            off = abs(d - world.ground_down(n, e))
            if off > worst:
                worst, where = off, (n, e, d)
        gone += leg
    return _off_ground("the distance of the path from the ground", worst, where, OFF_GROUND_M)


def _off_ground(rule: str, worst_m: float, where: Vec3, most_m: float) -> RuleFinding:
    measured = f"{worst_m:.3f} m at north {where[0]:.1f}, east {where[1]:.1f}"
    return RuleFinding(rule, worst_m <= most_m, measured, f"≤ {most_m:g} m")


def wheels(world: World) -> Iterator[RuleFinding]:
    """Yield whether all wheels of the target and its look-alikes touch the ground, along the whole path.

    Yield nothing if none of them has wheels.
    """
    way = motion(world.record.target)
    worst, where = -1.0, (0.0, 0.0, 0.0)
    for instance in world.target_and_lookalikes:
        if not has_wheels(instance.kind):
            continue
        poses = [(instance.position_ned, instance.turned)]
        if instance.movable:
            poses = [world.target_pose(float(t)) for t in _sweep(way)]
        low = contact_patch(instance.mesh)
        for place, turned in poses:
            for n, e, d in low @ turn(turned).T + np.array(place):
                off = abs(float(d) - world.ground_down(float(n), float(e)))
                if off > worst:
                    worst, where = off, (float(n), float(e), float(d))
    if worst >= 0.0:
        yield _off_ground("the distance of a wheel from the ground", worst, where, WHEEL_OFF_M)


def path_clear(world: World, obstacles: StaticObstacles) -> RuleFinding:
    """Return whether the target's box, moved along its path, hits no obstacle."""
    way = motion(world.record.target)
    for t in _sweep(way):
        place, yaw = way.pose(float(t))
        met = obstacles.overlapping(box_of(world.target.mesh, place, yaw, MARGIN_M, LIFT_M))
        if met:
            measured = f"{met}, after {t:.0f} s, at north {place[0]:.1f}, east {place[1]:.1f}"
            return RuleFinding("the obstacle on the target's path", False, measured, "nothing")
    return RuleFinding("the obstacle on the target's path", True, "nothing", "nothing")


def _sweep(way: TargetMotion) -> NDArray[np.float64]:
    """Return the times (s) at which the rules check a moving target."""
    last = min(CAP_S, way.length_m / way.speed_mps)
    return np.linspace(0.0, last, min(max(2, math.ceil(last * way.speed_mps / SWEEP_STEP_M) + 1), MOST_SWEEPS))


def path_length(world: World) -> RuleFinding:
    """Return whether the target still moves when the episode ends."""
    way = motion(world.record.target)
    least = way.speed_mps * CAP_S
    measured, wanted = f"{way.length_m:.1f} m", f"> {least:g} m, the distance covered in {CAP_S:g} s"
    return RuleFinding("the path's length", way.length_m > least, measured, wanted)


def pace(world: World) -> Iterator[RuleFinding]:
    """Yield whether the target moves at the speed that its map requires; nothing if the map requires no speed."""
    wanted = RULES.get(world.record.map, DEFAULT_RULES).speed_mps
    speed = motion(world.record.target).speed_mps
    if wanted is not None:
        yield RuleFinding("the target's speed", abs(speed - wanted) < 1e-9, f"{speed:g} m/s", f"{wanted:g} m/s")


def start_rules(world: World, obstacles: StaticObstacles) -> Iterator[RuleFinding]:
    yield from distance_and_bearing(world)
    yield from altitude(world)
    yield from free(world, obstacles)
    yield formation(world)


def distance_and_bearing(world: World) -> Iterator[RuleFinding]:
    """Yield whether the recorded distance and bearing match the scene.

    For an episode with one drone, yield also whether the map's rules allow them.
    """
    record, here, goal = world.record, world.record.starts[0].position_ned, world.target_centre(0.0)
    distance = math.dist(here, goal)
    bearing = bearing_deg(here, goal)
    off = abs(distance - record.start_distance_m)
    measured, wanted = f"{distance:.3f} m", f"{record.start_distance_m:g} m, as recorded"
    yield RuleFinding("the distance measured in the scene", off <= DISTANCE_OFF_M, measured, wanted, "start_distance_m")
    turned = abs(math.remainder(bearing - record.bearing_deg, 360.0))
    measured, wanted = f"{bearing:.2f}°", f"{record.bearing_deg:g}°, as recorded"
    yield RuleFinding("the bearing measured in the scene", turned <= BEARING_OFF_DEG, measured, wanted, "bearing_deg")
    if record.cell == "commanding":
        return
    of_map = RULES.get(record.map, DEFAULT_RULES)
    yield between("the distance from start to target", distance, of_map.start_distance_m, "m")
    if of_map.off_axes_deg > 0.0:
        from_axis = abs(math.remainder(bearing, 90.0))
        yield at_least("the bearing's angle to the map's axes", from_axis, of_map.off_axes_deg, "°", 1)


def altitude(world: World) -> Iterator[RuleFinding]:
    """Yield whether every drone starts at an allowed height, and above level ground."""
    heights = [world.ground_down(s.position_ned[0], s.position_ned[1]) - s.position_ned[2] for s in world.record.starts]
    limits = RULES.get(world.record.map, DEFAULT_RULES).altitude_m
    worst = max(heights, key=lambda h: abs(h - sum(limits) / 2))
    yield between("the height of a start above the ground", worst, limits, "m")
    steps = [unevenness_m(world, s.position_ned[0], s.position_ned[1]) for s in world.record.starts]
    yield at_most("the unevenness of the ground under a start", max(steps), LEVEL_M, "m")


def unevenness_m(world: World, north: float, east: float) -> float:
    """Return the largest difference in height (m) of the ground on a circle with the diameter REACH_M."""
    around = [2.0 * math.pi * k / RIM for k in range(RIM)]
    half = REACH_M / 2.0
    downs = [world.ground_down(north + half * math.cos(a), east + half * math.sin(a)) for a in around]
    return max(downs) - min(downs)


def free(world: World, obstacles: StaticObstacles) -> Iterator[RuleFinding]:
    """Yield whether no obstacle is within REACH_M of a drone, at its start and on its climb to the start."""
    worst, name = REACH_M, ""
    for start in world.record.starts:
        for point in climb(world, start):
            gap, met = obstacles.nearest(point, worst)
            if met:
                worst, name = gap, met
    measured = f"{worst:.2f} m, to {name}" if name else f"more than {REACH_M:g} m"
    yield RuleFinding("the free space around a drone's start and climb", not name, measured, f"≥ {REACH_M:g} m")


def climb(world: World, start: StartPose) -> Iterator[tuple[float, float, float]]:
    """Yield points (m, NED) on a drone's vertical climb from the ground to its start."""
    north, east, top = start.position_ned
    ground = world.ground_down(north, east)
    steps = max(1, math.ceil((ground - top) / CLIMB_STEP_M))
    for k in range(1, steps + 1):
        yield (north, east, ground + (top - ground) * k / steps)


def formation(world: World) -> RuleFinding:
    """Return whether a `commanding` episode has four drones that start in a square, and any other episode one drone."""
    starts, commanding = world.record.starts, world.record.cell == "commanding"
    if not commanding:
        return RuleFinding("the number of drones", len(starts) == 1, str(len(starts)), "1")
    if len(starts) != 4:
        return RuleFinding("the number of drones", False, str(len(starts)), "4")
    gaps = sorted(math.dist(a.position_ned[:2], b.position_ned[:2]) for a, b in itertools.combinations(starts, 2))
    wanted = [GRID_SIDE_M] * 4 + [GRID_SIDE_M * math.sqrt(2.0)] * 2
    off = max(abs(gap - want) for gap, want in zip(gaps, wanted, strict=True))
    measured = ", ".join(f"{gap:.2f}" for gap in gaps)
    return RuleFinding("the distances among the drones", off <= GRID_OFF_M, f"{measured} m", "a square of 2 m sides")
