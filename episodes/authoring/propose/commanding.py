"""A fleet and four look-alikes, of which the instruction names one by what is written on it."""

import itertools
import math
import random
from collections.abc import Generator, Iterator

from episodes.authoring.check.candidates import LETTER_M, PLATE_LETTER_M
from episodes.authoring.check.finding import (
    CANDIDATES,
    GRID_SIDE_M,
    GRID_TO_CANDIDATES_M,
    GRID_TO_TARGET_M,
    NEAREST_PAIR_M,
    READABLE_PX,
    READING_FOCAL_PX,
    WIDEST_PAIR_M,
)
from episodes.authoring.check.placement import box_of
from episodes.authoring.check.sight import CAMERA, across_all, bearing_deg, box_corners
from episodes.authoring.propose.draft import BOARDS, Draw, Proposal, flight_seed, inscribed, instruction, plates
from episodes.authoring.propose.site import PlacedTarget, Site, start
from episodes.maps import assets
from episodes.maps.places import Spot
from episodes.maps.scene import Instance
from episodes.records.record import TargetRecord
from foundation.frames import Vec3

CARS = ("sedan", "suv", "hatchback", "pickup", "van")  # their plates are 0.10 m and in sight from before and behind
SPARE_M = 0.3  # kept off every limit
ALTITUDES_M = (1.35, 2.05)  # over the ground in the middle of a grid: that under its corners differs
GROUPS = 3000  # groups of four places tried for one draft
GRIDS = 40  # places tried for the fleet of a group, by distances and room alone …
VIEWS = 6  # … and of those, by what the drones see
HALF_VIEW_DEG = 40.0  # of a picture that is 90° across, with room for the width of what stands there
ROADSIDE = ("kerb", "drive")  # kinds of place for vehicles
TURNED_GRIDS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)  # of a square of drones, against the way to a candidate
ABREAST_M = 0.4  # half of what a drone takes of another one's view, and a little
HIDES = 0.4  # of a thing's width: so much of it may be behind another drone
TURNED_DEG = 35.0  # that a sign may face past the fleet
SEEN = 0.3  # of every candidate, from every drone …
FACED = 0.6  # … and of the named one, from the first


def drafts(site: Site, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield drafts without end, each for the share that is sent: looks in turn, places at random."""
    share = yield None
    signs = site.name != "residential"
    kinds = ["sign"] if signs else list(CARS)
    paints = list(assets.PAINTS) if signs else (site.free_paints() or list(assets.PAINTS))
    boards = list(BOARDS)
    for deck in (kinds, paints, boards):
        rng.shuffle(deck)
    spots = tuple(s for s in site.places.spots if signs or s.place in ROADSIDE)
    if len(spots) < CANDIDATES:
        return
    for turn in itertools.count():
        asset, paint = kinds[turn % len(kinds)], paints[turn % len(paints)]
        texts = list(boards[turn % len(boards)]) if signs else plates(CANDIDATES, rng)
        rng.shuffle(texts)
        made = next(_groups(site, spots, asset, paint, texts, share, rng), None)
        if made is None:
            return
        share = yield made


def _groups(
    site: Site, spots: tuple[Spot, ...], asset: str, paint: str, texts: list[str], share: Draw, rng: random.Random
) -> Iterator[Proposal]:
    for _ in range(GROUPS):
        group = four(spots, rng)
        if group is None:
            continue
        centre = (sum(s.position_ned[0] for s in group) / 4, sum(s.position_ned[1] for s in group) / 4)
        toward = rng.uniform(-math.pi, math.pi)
        middles = []
        for _ in range(GRIDS):
            angle, away = toward + rng.uniform(-0.3, 0.3), rng.uniform(10.0, 32.0)
            middle = (centre[0] - away * math.cos(angle), centre[1] - away * math.sin(angle))
            if _far_enough(middle, group, asset) and all(site.free(p) for p in _grid(site, middle, angle, ALTITUDES_M)):
                middles.append(middle)
        if not middles:
            continue
        everyone = [_candidate(site, asset, paint, texts[k], group[k], toward, rng) for k in range(CANDIDATES)]
        things = [site.placed(one) for one in everyone]
        if any(_blocked(site, asset, thing) for thing in things):
            continue
        for middle in middles[:VIEWS]:
            made = _draft(site, everyone, things, middle, share, rng)
            if made is not None:
                yield made
                break


def four(spots: tuple[Spot, ...], rng: random.Random) -> list[Spot] | None:
    """Return four spots whose nearest and widest pairs are as they must be; None when a try misses."""
    first = rng.choice(spots)
    chosen, low, high = [first], NEAREST_PAIR_M[0] + SPARE_M, WIDEST_PAIR_M[1] - SPARE_M
    near = [s for s in spots if low <= math.dist(s.position_ned, first.position_ned) <= high]
    rng.shuffle(near)
    for one in near:
        ways = [math.dist(one.position_ned, other.position_ned) for other in chosen]
        if min(ways) >= low and max(ways) <= high:
            chosen.append(one)
        if len(chosen) == CANDIDATES:
            break
    if len(chosen) < CANDIDATES:
        return None
    pairs = [math.dist(a.position_ned, b.position_ned) for a, b in itertools.combinations(chosen, 2)]
    fits = min(pairs) <= NEAREST_PAIR_M[1] - SPARE_M and max(pairs) >= WIDEST_PAIR_M[0] + SPARE_M
    return chosen if fits else None


def _far_enough(middle: tuple[float, float], spots: list[Spot], asset: str) -> bool:
    """Return whether a fleet's place keeps its distances, near enough to be refined by the rules."""
    ways = [math.dist(middle, s.position_ned[:2]) for s in spots]
    unread = READING_FOCAL_PX * LETTER_M.get(asset, PLATE_LETTER_M) / READABLE_PX
    bearings = [math.atan2(s.position_ned[1] - middle[1], s.position_ned[0] - middle[0]) for s in spots]
    ahead = math.atan2(sum(map(math.sin, bearings)), sum(map(math.cos, bearings)))
    off = max(abs(math.degrees(math.remainder(b - ahead, 2.0 * math.pi))) for b in bearings)
    low = max(GRID_TO_CANDIDATES_M[0] + SPARE_M, unread + (1.0 if asset == "sign" else 0.0))
    return min(ways) >= low and max(ways) <= GRID_TO_CANDIDATES_M[1] - 1.0 and off <= HALF_VIEW_DEG


def _draft(
    site: Site,
    everyone: list[TargetRecord],
    things: list[PlacedTarget],
    middle: tuple[float, float],
    share: Draw,
    rng: random.Random,
) -> Proposal | None:
    """Return the draft of a fleet before four things; None when none is at the target's distance or one is hidden."""
    height = ALTITUDES_M[0] + share.height * (ALTITUDES_M[1] - ALTITUDES_M[0])
    bearings = [math.atan2(t.centre_ned[1] - middle[1], t.centre_ned[0] - middle[0]) for t in things]
    yaw = _yaw_deg(site, things, (*middle, site.ground(*middle) - height), share.turn)
    if yaw is None:
        return None
    for turned in rng.sample(TURNED_GRIDS_DEG, len(TURNED_GRIDS_DEG)):
        places = _grid(site, middle, bearings[0] + math.radians(turned), (height, height))
        if any(not site.on_map(p[0], p[1]) or not site.free(p) for p in places):
            continue
        if any(_in_the_way(k, places, things, yaw) for k in range(len(places))):
            continue
        if all(site.seen(thing, place, yaw) >= SEEN for thing in things for place in places):
            break
    else:
        return None
    low, high = GRID_TO_TARGET_M
    near = [
        k
        for k, thing in enumerate(things)
        if low + SPARE_M <= math.dist(middle, thing.centre_ned[:2]) <= high - SPARE_M
        and site.seen(thing, places[0], bearing_deg(places[0], thing.centre_ned)) >= FACED
        and site.clear(places[0], thing.centre_ned)
    ]
    if not near:
        return None
    named = rng.choice(near)
    target, others = everyone[named], tuple(one for k, one in enumerate(everyone) if k != named)
    words = inscribed(target.asset, str(target.inscription), rng)
    return Proposal(
        target=target,
        place_ned=things[named].position_ned,
        goal_ned=things[named].centre_ned,
        starts=tuple(start(place, yaw) for place in places),
        visible=True,
        instruction=instruction("commanding", words, target.asset, rng),
        seed=flight_seed(rng),
        candidates=others,
    )


def _yaw_deg(site: Site, things: list[PlacedTarget], middle: Vec3, share: float) -> float | None:
    """Return a yaw (deg) that shows every thing whole from the middle of the fleet; None when there is none."""
    framings = [site.framed(thing, middle) for thing in things]
    return across_all(framings, [bearing_deg(middle, thing.centre_ned) for thing in things], share)


def _in_the_way(drone: int, places: list[Vec3], things: list[PlacedTarget], yaw_deg: float) -> bool:
    """Return whether another drone of the fleet stands before most of a thing in a drone's picture."""
    yaw, lever = math.radians(yaw_deg), CAMERA.offset_frd[0]
    eye = (places[drone][0] + lever * math.cos(yaw), places[drone][1] + lever * math.sin(yaw))
    for other in (place for k, place in enumerate(places) if k != drone):
        way = math.atan2(other[1] - eye[1], other[0] - eye[0])
        wide = math.asin(min(1.0, ABREAST_M / math.dist(eye, other[:2])))
        for thing in things:
            corners = box_corners(thing.mesh, thing.position_ned, thing.yaw)
            beside = [math.remainder(math.atan2(e - eye[1], n - eye[0]) - way, 2.0 * math.pi) for n, e, _ in corners]
            low, high = min(beside), max(beside)
            if high - low < math.pi and min(high, wide) - max(low, -wide) > HIDES * (high - low):
                return True
    return False


def _candidate(
    site: Site, asset: str, paint: str, text: str, spot: Spot, toward: float, rng: random.Random
) -> TargetRecord:
    """Return a look-alike on a spot: a vehicle as the spot has it, a sign turned to whoever looks `toward` (rad)."""
    north, east, _ = spot.position_ned
    yaw = math.degrees(spot.yaw)
    if asset == "sign":
        yaw = math.degrees(toward) + 180.0 + rng.uniform(-TURNED_DEG, TURNED_DEG)
    place = (round(north, 3), round(east, 3), round(site.ground(round(north, 3), round(east, 3)), 3))
    return TargetRecord(asset, paint, text, place, round(math.remainder(yaw, 360.0), 1))


def _blocked(site: Site, asset: str, thing: PlacedTarget) -> bool:
    one = Instance(1, "candidate", asset, thing.mesh, thing.position_ned, thing.yaw)
    return bool(site.standing.met(box_of(one, one.position_ned, one.yaw, 0.2, 0.12)))


def _grid(site: Site, middle: tuple[float, float], ahead: float, heights_m: tuple[float, float]) -> list[Vec3]:
    """Return the places (m) of four drones in a square, in the middle of these heights above the ground under it."""
    down = site.ground(*middle) - sum(heights_m) / 2.0
    c, s, half = math.cos(ahead), math.sin(ahead), GRID_SIDE_M / 2.0
    corners = [
        (half, -half),
        (half, half),
        (-half, -half),
        (-half, half),
    ]  # front left, front right, rear left, rear right
    return [
        (round(middle[0] + c * x - s * y, 3), round(middle[1] + s * x + c * y, 3), round(down, 3)) for x, y in corners
    ]
