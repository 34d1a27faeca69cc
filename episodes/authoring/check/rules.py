"""Applies all rules to one record, to many records in a pool of processes, and to a suite.

The rules about a suite require that its targets are evenly spread, so that a pilot without a camera cannot guess where
they are. They apply to each cell (kind of episode) that has at least ENOUGH records on a map, and to all one-drone
records together if there are at least 4 · ENOUGH.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from episodes.authoring.check import candidates, placement, referring, sight
from episodes.authoring.check.finding import SPOTTED_PX, RuleFinding, at_least, at_most, between
from episodes.authoring.check.placement import StaticObstacles
from episodes.authoring.check.sight import CAMERA, HALF_VIEW_DEG, level, patch
from episodes.authoring.processes import process_map
from episodes.maps.geometry import assemble, box
from episodes.maps.scene import Instance, Material
from episodes.records import catalogue
from episodes.records.record import StartPose
from episodes.world.visibility import Solids, SolidsUnion
from episodes.world.world import World, solids
from foundation.errors import UsageError
from foundation.frames import Vec3, bearing_deg
from foundation.protocol import RADIUS_M, SPEED_MAX

ENOUGH = 5  # a rule about the spread of a cell's records on a map needs at least this many records
OFF_CENTRE_DEG = 15.0  # at least half of a cell's visible targets must be farther off the drone's nose than this
UNEVEN = 0.25  # target columns (bearings if hidden) may differ from an even spread by at most this (Kolmogorov's D)
CAMPUS_M = ((12.0, 14.0), (44.0, 48.0))  # m, limits of a suite's smallest and largest start distance on campus
HEIGHTS_M = ((1.2, 1.35), (2.05, 2.2))  # m, limits of a suite's lowest and highest start above the ground
LEAST_ROW_SPREAD = 0.05  # the lowest and the uppermost target differ by at least this share of the picture's height
# To pass a target means to come within 5 m of it and see it. A straight flight passes all targets at 16 m that are up
# to 14° off its heading, if no obstacle is in the way. Flights on three headings cover the usable 74° of the
# picture. So of any ten visible targets, one of these three flights passes at least four.
# Key: whether the targets are visible at the start. Value: how many of ten targets a straight flight may pass.
AHEAD = {True: 2, False: 1}  # if it flies straight ahead
ANY_HEADING = {True: 4, False: 2}  # on the best heading

HEADING_STEP_DEG = 2  # between checked headings
ALONG_STEP_M = 0.5  # between checked points of a flight
CLEAR_M = 0.3  # free space on each side of a straight flight
DRONE_ID = 1_000_000  # id of the first drone, above all ids of a scene
DRONE_M = (0.35, 0.35, 0.13)  # half size of a drone with its rotors: length, width, height


@dataclass(frozen=True, slots=True)
class Layout:
    """The values of one record that the rules about a suite use."""

    id: str
    map: str
    cell: str
    seed: int
    off_deg: float  # bearing of the target's middle from the first drone's nose, -180 … 180, + to the right
    column: float | None  # 0 … 1, left to right, of the target's middle in the first picture; None if not visible
    row: float | None  # 0 … 1, top to bottom, of the target's middle; None if not visible
    distance_m: float
    height_m: float  # height of the first start above the ground under it
    straight_deg: frozenset[int]  # headings that `straight` returns; empty for a fleet
    fewest_px: int | None  # result of `fewest_candidate_pixels`; None for one drone


def check(world: World) -> list[RuleFinding]:
    """Return the findings of all rules about a world's record, in a fixed order."""
    obstacles = StaticObstacles(world.scene.instances)
    place = "target.position_ned" if world.record.target.path is None else "target.path"
    return [
        *_about("starts", placement.start_rules(world, obstacles)),
        *_about("starts", sight.rules(world)),
        *_about(place, placement.target_rules(world, obstacles)),
        *_about("candidates", candidates.rules(world, obstacles)),
        *_about("instruction", referring.rules(world)),
    ]


def _about(field: str, findings: Iterable[RuleFinding]) -> list[RuleFinding]:
    """Return the findings. Those without a field get `field`."""
    return [finding if finding.field else replace(finding, field=field) for finding in findings]


@dataclass(frozen=True, slots=True)
class Report:
    """The findings about one record."""

    name: str  # id of the record; `source` if the record cannot be read
    source: str  # id, file or folder
    findings: tuple[RuleFinding, ...] = ()
    error: str | None = None  # message, if the record cannot be read or its world cannot be built
    layout: Layout | None = None  # for the rules about a suite

    @property
    def reason(self) -> str | None:
        """Return why the record is rejected, in one line with source, field and reason; None if it is accepted."""
        if self.error:
            return self.error
        failed = "; ".join(f.sentence for f in self.findings if not f.passed)
        return f"{self.source}: {failed}." if failed else None


def check_one(source: str, laid_out: bool = False) -> Report:
    """Return the report on the record `source` (id, file or folder), with the record's layout if `laid_out`."""
    name = source
    try:
        record = catalogue.load(source)
        name = record.id
        world = World(record)
        return Report(name, source, tuple(check(world)), layout=layout(world) if laid_out else None)
    except UsageError as error:
        return Report(name, source, error=str(error))


def check_all(sources: Sequence[str], jobs: int | None = None, laid_out: bool = False) -> Iterator[Report]:
    """Yield the reports in the order in which `jobs` processes (default: one per core) finish them."""
    yield from process_map(partial(check_one, laid_out=laid_out), sources, jobs)


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
        fewest_px=fewest_candidate_pixels(world) if fleet else None,
    )


def _in_picture(start: StartPose, goal: Vec3) -> tuple[float, float]:
    """Return the column and the row (0 … 1) of a point in the picture of a level drone."""
    yaw = math.radians(start.yaw_deg)
    north, east = goal[0] - start.position_ned[0], goal[1] - start.position_ned[1]
    lever = CAMERA.offset_frd
    ahead = north * math.cos(yaw) + east * math.sin(yaw) - lever[0]
    right = east * math.cos(yaw) - north * math.sin(yaw) - lever[1]
    below = goal[2] - start.position_ned[2] - lever[2]
    focal = CAMERA.focal_px / max(ahead, 1e-3)
    return 0.5 + focal * right / CAMERA.width, 0.5 + focal * below / CAMERA.height


def straight(world: World, off_deg: float) -> frozenset[int]:
    """Return the headings relative to the nose (°, -180 … 179) on which a straight flight can make a true declaration.

    On such a heading the drone comes within RADIUS_M of the target and sees it. The flight is level, nose first, and
    ends at the first obstacle. Only multiples of HEADING_STEP_DEG are checked.
    """
    here = world.record.starts[0].position_ned
    span = max(math.dist(here, world.target_centre(0.0)), 1e-3)
    path = world.record.target.path
    drift = 0.0 if path is None else path.speed_mps * (span + RADIUS_M) / SPEED_MAX
    wide = math.degrees(math.asin(min(1.0, (RADIUS_M + drift) / span)))
    first = round(world.record.starts[0].yaw_deg)
    low, high = math.floor(off_deg - wide), math.ceil(off_deg + wide)
    passing = (h for h in range(low, high + 1) if h % HEADING_STEP_DEG == 0 and _passes(world, first + h, span, drift))
    return frozenset((h + 180) % 360 - 180 for h in passing)


def _passes(world: World, heading_deg: float, span_m: float, drift_m: float) -> bool:
    here, yaw, attitude = world.record.starts[0].position_ned, math.radians(heading_deg), level(heading_deg)
    north, east = math.cos(yaw), math.sin(yaw)
    sides = [(here[0] - side * east, here[1] + side * north, here[2]) for side in (-CLEAR_M, 0.0, CLEAR_M)]
    free = min(world.solids.range_m(side, (north, east, 0.0)) for side in sides) - CLEAR_M
    near = max(span_m - RADIUS_M - drift_m, 0.0)
    for along in np.arange(near, min(free, span_m + RADIUS_M + drift_m), ALONG_STEP_M):
        t, place = float(along) / SPEED_MAX, (here[0] + along * north, here[1] + along * east, here[2])
        if math.dist(place, world.target_centre(t)) <= RADIUS_M and world.measure(t, place, attitude, CAMERA).visible:
            return True
    return False


def fewest_candidate_pixels(world: World) -> int:
    """Return the smallest number of pixels that any candidate has in any drone's first picture.

    Other candidates and drones may hide a candidate.
    """
    record, of_map = world.record, solids(world.record.map, world.record.map_seed)
    targets = world.target_and_lookalikes
    drones = [_drone(k, start) for k, start in enumerate(record.starts)]
    fewest = math.inf
    for target in targets:
        for drone, start in zip(drones, record.starts, strict=True):
            past = SolidsUnion(of_map, Solids(i for i in (*targets, *drones) if i is not target and i is not drone))
            fewest = min(fewest, patch(target, past, start.position_ned, level(start.yaw_deg)).pixels)
    return int(fewest)


def _drone(number: int, start: StartPose) -> Instance:
    """Return the box of a drone that hovers at a start."""
    reach, yaw = np.array(DRONE_M), math.radians(start.yaw_deg)
    mesh = assemble([box(-reach, reach, Material("drone", (0.2, 0.2, 0.2)))])
    return Instance(DRONE_ID + number, f"drone-{number + 1}", "drone", mesh, start.position_ned, yaw)


def check_suite(layouts: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about a suite."""
    seeds = Counter(layout.seed for layout in layouts)
    twice = [layout.id for layout in layouts if seeds[layout.seed] > 1]
    yield RuleFinding("the seeds", not twice, ", ".join(twice[:4]) or "all distinct", "one for each record", "seed")
    cells: dict[tuple[str, str], list[Layout]] = defaultdict(list)
    for layout in layouts:
        cells[layout.map, layout.cell].append(layout)
    for (place, cell), of_cell in sorted(cells.items()):
        if len(of_cell) >= ENOUGH:
            yield from check_cell(f"{place} {cell}", of_cell)
    one_drone = [layout for layout in layouts if layout.cell != "commanding"]
    if len(one_drone) >= 4 * ENOUGH:
        yield from check_one_drone(one_drone)


def check_one_drone(layouts: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about all one-drone records of a suite together."""
    campus = [layout.distance_m for layout in layouts if layout.map == "campus"]
    if campus:
        yield between("the nearest start on campus", min(campus), CAMPUS_M[0], "m")
        yield between("the farthest start on campus", max(campus), CAMPUS_M[1], "m")
    heights = [layout.height_m for layout in layouts]
    yield between("the lowest start", min(heights), HEIGHTS_M[0], "m")
    yield between("the highest start", max(heights), HEIGHTS_M[1], "m")
    rows = [layout.row for layout in layouts if layout.row is not None]
    if rows:
        rule = "the spread of the targets' heights in the picture, as a share of the picture"
        yield at_least(rule, max(rows) - min(rows), LEAST_ROW_SPREAD, "")


def check_cell(name: str, layouts: Sequence[Layout]) -> Iterator[RuleFinding]:
    """Yield the findings about the records of one cell on one map."""
    if layouts[0].fewest_px is not None:
        least = min(layout.fewest_px or 0 for layout in layouts)
        rule = f"{name}: the smallest visible part of a candidate behind the others"
        yield at_least(rule, least, SPOTTED_PX, "px", 0)
        return
    in_sight = layouts[0].column is not None
    if in_sight:
        off = sum(abs(layout.off_deg) > OFF_CENTRE_DEG for layout in layouts)
        yield at_least(f"{name}: targets more than {OFF_CENTRE_DEG:g}° off the nose", off, len(layouts) / 2, "", 0)
        shares = [layout.column for layout in layouts if layout.column is not None]
        rule = f"{name}: the unevenness of the targets' columns"
    else:
        hiding = 360.0 - 2.0 * HALF_VIEW_DEG
        shares = [(layout.off_deg % 360.0 - HALF_VIEW_DEG) / hiding for layout in layouts]
        rule = f"{name}: the unevenness of the bearings of hidden targets"
    yield at_most(rule, unevenness(shares), UNEVEN, "")
    ahead, most = passed(layouts)
    limits = passable(in_sight, len(layouts))
    yield at_most(f"{name}: records that a flight straight ahead passes", ahead, limits[0], "", 0)
    yield at_most(f"{name}: records that a straight flight passes on any one heading", most, limits[1], "", 0)


def passed(layouts: Sequence[Layout]) -> tuple[int, int]:
    """Return the number of records whose target a flight passes: straight ahead, and on the best heading."""
    count = Counter(heading for layout in layouts for heading in layout.straight_deg)
    return count[0], max(count.values(), default=0)


def passable(in_sight: bool, count: int) -> tuple[float, float]:
    """Return the limits of `passed` for `count` records of a cell."""
    return AHEAD[in_sight] * count / 10.0, ANY_HEADING[in_sight] * count / 10.0


def unevenness(shares: Iterable[float]) -> float:
    """Return Kolmogorov's D: the largest difference of the shares' distribution from the uniform one on 0 … 1."""
    ordered = sorted(shares)
    n = len(ordered)
    return max(max((k + 1) / n - u, u - k / n) for k, u in enumerate(ordered))
