"""Rules about a suite: drawn so evenly that nobody who does not look can know where the targets are.

They hold for the episodes that ship as `all`, and for each cell of a map that has records enough. What a pilot that
flies straight on without looking would pass is measured of each record (`layout.straight`) and counted here, so that
the rule names no pilot.

The layout of a record is what these rules go by: where the target stands to the nose, and what chance would find.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from episodes.authoring.check.finding import SPOTTED_PX, RuleFinding, at_least, at_most, between
from episodes.authoring.check.sight import CAMERA, HALF_VIEW_DEG, bearing_deg, level, patch
from episodes.maps.geometry import assemble, box
from episodes.maps.scene import Instance, Material
from episodes.records.record import StartPose
from episodes.world.visibility import Solids, Together
from episodes.world.world import World, solids
from foundation.frames import Vec3
from foundation.protocol import RADIUS_M, SPEED_MAX

HEADING_STEP_DEG = 2
ALONG_STEP_M = 0.5
CLEAR_M = 0.3  # to both sides of a straight flight
NUMBERED = 1_000_000  # ids of drones, beyond those of any scene
DRONE_M = (0.35, 0.35, 0.13)  # half of a drone, rotors included: length, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """One record among others."""

    id: str
    map: str
    cell: str
    seed: int
    off_deg: float  # bearing of the target's middle off the first drone's nose, -180 … 180, + to the right
    column: float | None  # 0 … 1, left to right, of that middle in the first picture; None where it is not in it
    row: float | None  # 0 … 1, top to bottom
    distance_m: float
    height_m: float  # of the first start above the ground under it
    straight_deg: frozenset[int]  # headings from the nose on which a level straight flight comes to a true declaration
    fewest_px: int | None  # of a fleet: the least that a drone sees of a candidate past the other drones


def layout(world: World) -> Layout:
    """Return the layout of a world's record."""
    record, first = world.record, world.record.starts[0]
    goal = world.target_centre(0.0)
    off = math.remainder(bearing_deg(first.position_ned, goal) - first.yaw_deg, 360.0)
    column, row = _in_picture(first, goal) if record.visible_at_start else (None, None)
    fleet = record.cell == "commanding"
    return Layout(
        id=record.id,
        map=record.map,
        cell=record.cell,
        seed=record.seed,
        off_deg=off,
        column=column,
        row=row,
        distance_m=math.dist(first.position_ned, goal),
        height_m=world.ground_down(*first.position_ned[:2]) - first.position_ned[2],
        straight_deg=frozenset() if fleet else straight(world, off),
        fewest_px=past_each_other(world) if fleet else None,
    )


def _in_picture(start: StartPose, goal: Vec3) -> tuple[float, float]:
    """Return the column and the row (0 … 1) of a point before a level drone."""
    yaw = math.radians(start.yaw_deg)
    north, east = goal[0] - start.position_ned[0], goal[1] - start.position_ned[1]
    lever = CAMERA.offset_frd
    ahead = north * math.cos(yaw) + east * math.sin(yaw) - lever[0]
    right = east * math.cos(yaw) - north * math.sin(yaw) - lever[1]
    below = goal[2] - start.position_ned[2] - lever[2]
    focal = CAMERA.focal_px / max(ahead, 1e-3)
    return 0.5 + focal * right / CAMERA.width, 0.5 + focal * below / CAMERA.height


def straight(world: World, off_deg: float) -> frozenset[int]:
    """Return the headings from the nose (whole degrees, -180 … 179) that pass a target within the radius, in view.

    The flight is level, goes straight from the start until something stands in its way, and looks where it goes.
    """
    here = world.record.starts[0].position_ned
    span = max(math.dist(here, world.target_centre(0.0)), 1e-3)
    path = world.record.target.path
    drift = 0.0 if path is None else path.speed_mps * (span + RADIUS_M) / SPEED_MAX
    wide = math.degrees(math.asin(min(1.0, (RADIUS_M + drift) / span)))
    first = round(world.record.starts[0].yaw_deg)
    low, high = math.floor(off_deg - wide), math.ceil(off_deg + wide)
    found = (h for h in range(low, high + 1) if h % HEADING_STEP_DEG == 0 and _passes(world, first + h, span, drift))
    return frozenset((h + 180) % 360 - 180 for h in found)


def _passes(world: World, heading_deg: float, span_m: float, drift_m: float) -> bool:
    here, yaw, attitude = world.record.starts[0].position_ned, math.radians(heading_deg), level(heading_deg)
    north, east = math.cos(yaw), math.sin(yaw)
    sides = [(here[0] - side * east, here[1] + side * north, here[2]) for side in (-CLEAR_M, 0.0, CLEAR_M)]
    free = min(world.solids.range_m(one, (north, east, 0.0)) for one in sides) - CLEAR_M
    near = max(span_m - RADIUS_M - drift_m, 0.0)
    for along in np.arange(near, min(free, span_m + RADIUS_M + drift_m), ALONG_STEP_M):
        t, place = float(along) / SPEED_MAX, (here[0] + along * north, here[1] + along * east, here[2])
        if math.dist(place, world.target_centre(t)) <= RADIUS_M and world.measure(t, place, attitude, CAMERA).visible:
            return True
    return False


def past_each_other(world: World) -> int:
    """Return the fewest pixels that a drone of a fleet has of a candidate, the other drones standing in the way."""
    record, standing = world.record, solids(world.record.map, world.record.map_seed)
    things = world.target_and_lookalikes
    drones = [_drone(k, start) for k, start in enumerate(record.starts)]
    fewest = math.inf
    for one in things:
        for drone, start in zip(drones, record.starts, strict=True):
            others = [i for i in things if i is not one] + [i for i in drones if i is not drone]
            past = Together(standing, Solids(others))
            spot = patch(one, one.position_ned, one.turned, past, start.position_ned, level(start.yaw_deg), CAMERA)
            fewest = min(fewest, spot.pixels)
    return int(fewest)


def _drone(number: int, start: StartPose) -> Instance:
    """Return a drone that hovers at a start, as the box around it."""
    reach = np.array(DRONE_M)
    mesh = assemble([box(-reach, reach, Material("drone", (0.2, 0.2, 0.2)))])
    return Instance(
        NUMBERED + number, f"drone-{number + 1}", "drone", mesh, start.position_ned, math.radians(start.yaw_deg)
    )


ENOUGH = 5  # records of a cell on a map, for a rule about their spread
OFF_CENTRE_DEG = 15.0  # at least half of the targets in sight stand farther from the nose than this
UNEVEN = 0.25  # largest difference (Kolmogorov's) of a cell's ten draws from an even spread
CAMPUS_M = ((12.0, 14.0), (44.0, 48.0))  # where the nearest and the farthest start on campus lie
HEIGHTS_M = ((1.2, 1.35), (2.05, 2.2))  # where the lowest and the highest start lie
ROWS = 0.05  # of the picture's height, from the uppermost to the lowest target in a suite
# Of ten in sight 16 m off, a flight straight on passes within 5 m of whatever stands up to 14° beside its way: of the
# picture's usable 74° that is more than a third, so no spread leaves fewer than three to every heading.
AHEAD = {True: 2, False: 1}  # of ten in sight or hidden, passed by flying straight on as the record faces …
ANY_HEADING = {True: 4, False: 2}  # … and on the one heading from the nose that passes most


def rules(layouts: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about a suite."""
    seeds = Counter(one.seed for one in layouts)
    twice = [one.id for one in layouts if seeds[one.seed] > 1]
    yield RuleFinding("the seeds", not twice, ", ".join(twice[:4]) or "all distinct", "one for each record", "seed")
    cells: dict[tuple[str, str], list[Layout]] = defaultdict(list)
    for one in layouts:
        cells[one.map, one.cell].append(one)
    for (place, cell), found in sorted(cells.items()):
        if len(found) >= ENOUGH:
            yield from of_cell(f"{place} {cell}", found)
    flown = [one for one in layouts if one.cell != "commanding"]
    if len(flown) >= 4 * ENOUGH:
        yield from of_suite(flown)


def of_suite(flown: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about the one-drone records together."""
    campus = [one.distance_m for one in flown if one.map == "campus"]
    if campus:
        yield between("the nearest start on campus", min(campus), CAMPUS_M[0], "m")
        yield between("the farthest start on campus", max(campus), CAMPUS_M[1], "m")
    heights = [one.height_m for one in flown]
    yield between("the lowest start", min(heights), HEIGHTS_M[0], "m")
    yield between("the highest start", max(heights), HEIGHTS_M[1], "m")
    rows = [one.row for one in flown if one.row is not None]
    if rows:
        yield at_least(
            "the rows of the picture from the uppermost to the lowest target", max(rows) - min(rows), ROWS, ""
        )


def of_cell(name: str, found: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about the records of one cell on one map."""
    if found[0].fewest_px is not None:
        least = min(one.fewest_px or 0 for one in found)
        yield at_least(
            f"{name}: the least that a drone sees of a candidate past the others", least, SPOTTED_PX, "px", 0
        )
        return
    in_sight = found[0].column is not None
    if in_sight:
        off = sum(abs(one.off_deg) > OFF_CENTRE_DEG for one in found)
        yield at_least(f"{name}: targets more than {OFF_CENTRE_DEG:g}° off the nose", off, len(found) / 2, "", 0)
        shares = [one.column for one in found if one.column is not None]
        rule = f"{name}: how uneven the columns of the targets are"
    else:
        shares = [(one.off_deg % 360.0 - HALF_VIEW_DEG) / (360.0 - 2.0 * HALF_VIEW_DEG) for one in found]
        rule = f"{name}: how uneven the yaws are over those that hide the target"
    yield at_most(rule, unevenness(shares), UNEVEN, "")
    ahead, most = passed(found)
    limits = passable(in_sight, len(found))
    yield at_most(f"{name}: records that a flight straight on passes", ahead, limits[0], "", 0)
    yield at_most(f"{name}: records that a straight flight passes on any one heading", most, limits[1], "", 0)


def passed(found: Sequence[Layout]) -> tuple[int, int]:
    """Return how many records a flight straight on passes, and how many one on the heading that passes most."""
    counted = Counter(heading for one in found for heading in one.straight_deg)
    return counted[0], max(counted.values(), default=0)


def passable(in_sight: bool, count: int) -> tuple[float, float]:
    """Return how many of so many records of a cell a straight flight may pass: straight on, and on any one heading."""
    return AHEAD[in_sight] * count / 10.0, ANY_HEADING[in_sight] * count / 10.0


def unevenness(shares: Iterable[float]) -> float:
    """Return the largest difference between the shares' distribution and an even one on 0 … 1 (Kolmogorov's D)."""
    ordered = sorted(shares)
    n = len(ordered)
    return max(max((k + 1) / n - u, u - k / n) for k, u in enumerate(ordered))
