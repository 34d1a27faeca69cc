"""Where the drones begin: as far off as the record says, at a fair height, and free to take off there."""

import itertools
import math
from collections.abc import Iterator

from episodes.authoring.check.finding import RuleFinding, at_least, at_most, between
from episodes.authoring.check.limits import (
    BEARING_OFF_DEG,
    DISTANCE_OFF_M,
    GRID_OFF_M,
    GRID_SIDE_M,
    LEVEL_M,
    OF_OTHER_MAPS,
    REACH_M,
    RULES,
)
from episodes.authoring.check.solid import StandingObstacles
from episodes.records.record import StartPose
from episodes.world.world import World

CLIMB_STEP_M = 0.2
RIM = 16  # points around a start at which the ground is looked at


def rules(world: World, standing: StandingObstacles) -> Iterator[RuleFinding]:
    """Yield the findings about the starts."""
    yield from distance_and_bearing(world)
    yield from altitude(world)
    yield from free(world, standing)
    yield formation(world)


def distance_and_bearing(world: World) -> Iterator[RuleFinding]:
    """Yield whether the record says what is measured, and whether that is what its map demands."""
    record, here, goal = world.record, world.record.starts[0].position_ned, world.target_centre(0.0)
    distance = math.dist(here, goal)
    bearing = math.degrees(math.atan2(goal[1] - here[1], goal[0] - here[0])) % 360.0
    off = abs(distance - record.start_distance_m)
    says, told = f"{distance:.3f} m", f"{record.start_distance_m:g} m, as recorded"
    yield RuleFinding("the distance measured in the scene", off <= DISTANCE_OFF_M, says, told, "start_distance_m")
    turned = abs(math.remainder(bearing - record.bearing_deg, 360.0))
    says, told = f"{bearing:.2f}°", f"{record.bearing_deg:g}°, as recorded"
    yield RuleFinding("the bearing measured in the scene", turned <= BEARING_OFF_DEG, says, told, "bearing_deg")
    if record.cell == "commanding":
        return
    of_map = RULES.get(record.map, OF_OTHER_MAPS)
    yield between("the distance from start to target", distance, of_map.start_distance_m, "m")
    if of_map.off_axes_deg > 0.0:
        from_axis = abs(math.remainder(bearing, 90.0))
        yield at_least("the bearing's angle to the map's axes", from_axis, of_map.off_axes_deg, "°", 1)


def altitude(world: World) -> Iterator[RuleFinding]:
    """Yield whether every drone starts at a fair height above the ground under it, and that is level."""
    heights = [world.ground_down(s.position_ned[0], s.position_ned[1]) - s.position_ned[2] for s in world.record.starts]
    limits = RULES.get(world.record.map, OF_OTHER_MAPS).altitude_m
    worst = max(heights, key=lambda h: abs(h - sum(limits) / 2))
    yield between("the height of a start above the ground", worst, limits, "m")
    steps = [unevenness_m(world, s.position_ned[0], s.position_ned[1]) for s in world.record.starts]
    yield at_most("the unevenness of the ground under a start", max(steps), LEVEL_M, "m")


def unevenness_m(world: World, north: float, east: float) -> float:
    """Return by how much (m) the ground differs in height under a vehicle that stands there."""
    around = [2.0 * math.pi * k / RIM for k in range(RIM)]
    half = REACH_M / 2.0
    downs = [world.ground_down(north + half * math.cos(a), east + half * math.sin(a)) for a in around]
    return max(downs) - min(downs)


def free(world: World, standing: StandingObstacles) -> Iterator[RuleFinding]:
    """Yield whether nothing stands where a drone spawns and climbs to its start."""
    worst, name = REACH_M, ""
    for start in world.record.starts:
        for point in climb(world, start):
            gap, met = standing.nearest(point, worst)
            if met:
                worst, name = gap, met
    says = f"{worst:.2f} m, to {name}" if name else f"more than {REACH_M:g} m"
    yield RuleFinding("the room of a drone at its start and on its climb to it", not name, says, f"≥ {REACH_M:g} m")


def climb(world: World, start: StartPose) -> Iterator[tuple[float, float, float]]:
    """Yield the points (m, NED) of a drone's way from the ground up to its start."""
    north, east, top = start.position_ned
    ground = world.ground_down(north, east)
    steps = max(1, math.ceil((ground - top) / CLIMB_STEP_M))
    for k in range(1, steps + 1):
        yield (north, east, ground + (top - ground) * k / steps)


def formation(world: World) -> RuleFinding:
    """Return whether the drones are as many as the cell has, and a fleet of four in its grid."""
    starts, commanding = world.record.starts, world.record.cell == "commanding"
    if not commanding:
        return RuleFinding("the number of drones", len(starts) == 1, str(len(starts)), "1")
    if len(starts) != 4:
        return RuleFinding("the number of drones", False, str(len(starts)), "4")
    gaps = sorted(math.dist(a.position_ned[:2], b.position_ned[:2]) for a, b in itertools.combinations(starts, 2))
    wanted = [GRID_SIDE_M] * 4 + [GRID_SIDE_M * math.sqrt(2.0)] * 2
    off = max(abs(gap - want) for gap, want in zip(gaps, wanted, strict=True))
    says = ", ".join(f"{gap:.2f}" for gap in gaps)
    return RuleFinding("the distances among the drones", off <= GRID_OFF_M, f"{says} m", "a square of 2 m sides")
