"""Changes the number of drones of a record.

For fewer drones, the record keeps its first starts. For more drones, the record must have a square of four starts. The
other starts are lattice places, 2 m apart, behind and beside the square, nearest first. A place is used if the record
still passes its checks: room to hover and to climb, level ground, a valid height, all candidates (the target and its
look-alikes) in sight, and no inscription legible. This procedure has no source: the paper flies one drone or four.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

from episodes.authoring.check import candidates, rules
from episodes.authoring.check.finding import DEFAULT_RULES, LEVEL_M, RULES, RuleFinding
from episodes.authoring.check.placement import StaticObstacles, climb, formation, unevenness_m
from episodes.records.record import MAX_STARTS, EpisodeRecord, StartPose
from episodes.world.obstacles import REACH_M
from episodes.world.world import World
from foundation.errors import UsageError

FLEET = 4  # drones of the shipped commanding records
RINGS = 3  # rings of lattice places around the square that are tried


def with_drones(record: EpisodeRecord, drones: int) -> EpisodeRecord:
    """Return the record with this number of starts. Raises UsageError if the record cannot have so many."""
    if not 1 <= drones <= MAX_STARTS:
        raise UsageError(f"--drones must be a whole number from 1 to {MAX_STARTS}, got {drones}")
    if drones <= len(record.starts):
        return replace(record, starts=record.starts[:drones])
    if record.cell != "commanding":
        raise UsageError(f"--drones {drones}: {record.id} is an episode for one drone. Name a commanding episode")
    if len(record.starts) != FLEET or not formation(World(record)).passed:
        raise UsageError(
            f"--drones {drones}: the start places of {record.id} are not a square of 2 m, so no more"
            " drones can be added"
        )
    world = World(record)
    obstacles = StaticObstacles(world.scene.instances)
    for place in places(record.starts):
        if len(record.starts) == drones:
            break
        more = replace(record, starts=(*record.starts, place))
        if has_room(world, obstacles, place) and in_sight(more):
            record = more
    if len(record.starts) < drones:
        raise UsageError(
            f"--drones {drones}: the start places of {record.id} have room for {len(record.starts)} drones only"
        )
    if failure := next(failed(record), None):
        raise UsageError(
            f"--drones {drones}: {record.id} with so many drones does not pass its checks: {failure.sentence}"
        )
    return record


def has_room(world: World, obstacles: StaticObstacles, place: StartPose) -> bool:
    """Return whether a place has a valid height above level ground, and nothing blocks the climb to it."""
    north, east, down = place.position_ned
    least, most = RULES.get(world.record.map, DEFAULT_RULES).altitude_m
    fair = least <= world.ground_down(north, east) - down <= most
    level = unevenness_m(world, north, east) <= LEVEL_M
    return fair and level and not any(obstacles.nearest(point, REACH_M)[1] for point in climb(world, place))


def in_sight(record: EpisodeRecord) -> bool:
    """Return whether every drone sees every candidate past the other drones, and reads no inscription."""
    return all(finding.passed for finding in candidates.rules(World(record), StaticObstacles(())))


def failed(record: EpisodeRecord) -> Iterator[RuleFinding]:
    """Yield the failed findings about a record, except the finding about its number of drones."""
    world = World(record)
    number = formation(world).rule
    yield from (finding for finding in rules.check(world) if not finding.passed and finding.rule != number)


def places(square: tuple[StartPose, ...]) -> Iterator[StartPose]:
    """Yield more places of the lattice of `square` (front left, front right, rear left, rear right), nearest first.

    No place is ahead of the square: a drone there would be in the other drones' pictures and nearer to the candidates.
    """
    corners = [start.position_ned for start in square]
    north, east, down = (sum(axis) / len(corners) for axis in zip(*corners, strict=True))
    right = (corners[1][0] - corners[0][0], corners[1][1] - corners[0][1])
    ahead = (corners[0][0] - corners[2][0], corners[0][1] - corners[2][1])
    steps = [k + 0.5 for k in range(-RINGS - 1, RINGS + 1)]
    lattice = [(a, r) for a, r in itertools.product(steps, steps) if a < 1.0 and not (abs(a) < 1.0 and abs(r) < 1.0)]
    for a, r in sorted(lattice, key=lambda place: (round(math.hypot(*place), 6), place)):
        place = (north + a * ahead[0] + r * right[0], east + a * ahead[1] + r * right[1], down)
        yield StartPose((round(place[0], 3), round(place[1], 3), round(place[2], 3)), square[0].yaw_deg)
