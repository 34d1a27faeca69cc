"""Drafts episodes with a fleet and four similar candidates. The instruction names one candidate by its inscription."""

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
from episodes.authoring.check.sight import CAMERA, box_corners, yaw_showing_all
from episodes.authoring.propose.draft import BOARDS, Draw, Proposal, flight_seed, inscribed, instruction, plates
from episodes.authoring.propose.site import Site, rounded, start
from episodes.maps import assets
from episodes.maps.scene import Instance, Spot
from episodes.records.record import TargetRecord
from foundation.frames import Vec3, bearing_deg, course

CARS = ("sedan", "suv", "hatchback", "pickup", "van")  # with plates at the front and at the rear; digits 0.10 m high
SPARE_M = 0.3  # margin kept from every limit of a distance
ALTITUDES_M = (1.35, 2.05)  # start height above the ground under the middle of the grid (the fleet's square)
GROUPS = 3000  # groups of four places tried for one draft
GRIDS = 40  # places of the fleet tried per group, checked for distances and free space
VIEWS = 6  # at most this many of the places that pass are checked for the drones' views
HALF_VIEW_DEG = 40.0  # a candidate is at most this far off the axis of a 90° wide picture, to leave room for its width
ROADSIDE = ("kerb", "drive")  # kinds of spots on which vehicles may stand
TURNED_GRIDS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)  # tried angles between grid and direction to first candidate
ABREAST_M = 0.4  # half width of a drone in the view of another drone, with a margin
HIDES = 0.4  # another drone may cover at most this share of a candidate's width
TURNED_DEG = 35.0  # a sign faces the fleet to within this angle
SEEN = 0.3  # every drone sees at least this share of every candidate
FACED = 0.6  # the first drone sees at least this share of the target when it faces the target


def drafts(site: Site, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield None, then a draft for each `Draw` (random shares of allowed ranges) sent in. Assets and paints take turns.

    End if the map has fewer than CANDIDATES spots, or if GROUPS groups of spots give no draft.
    """
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
        draft = next(_groups(site, spots, asset, paint, texts, share, rng), None)
        if draft is None:
            return
        share = yield draft


def _groups(
    site: Site, spots: tuple[Spot, ...], asset: str, paint: str, texts: list[str], share: Draw, rng: random.Random
) -> Iterator[Proposal]:
    for _ in range(GROUPS):
        group = four_spots(spots, rng)
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
        records = [_candidate(site, asset, paint, texts[k], group[k], toward, rng) for k in range(CANDIDATES)]
        candidates = [site.placed(record) for record in records]
        boxes = (box_of(c.mesh, c.position_ned, c.yaw, 0.2, 0.12) for c in candidates)
        if any(site.obstacles.overlapping(box) for box in boxes):
            continue
        for middle in middles[:VIEWS]:
            draft = _draft(site, records, candidates, middle, share, rng)
            if draft is not None:
                yield draft
                break


def four_spots(spots: tuple[Spot, ...], rng: random.Random) -> list[Spot] | None:
    """Return four random spots that keep NEAREST_PAIR_M and WIDEST_PAIR_M; None if this try fails."""
    first = rng.choice(spots)
    chosen, low, high = [first], NEAREST_PAIR_M[0] + SPARE_M, WIDEST_PAIR_M[1] - SPARE_M
    near = [s for s in spots if low <= math.dist(s.position_ned, first.position_ned) <= high]
    rng.shuffle(near)
    for spot in near:
        distances = [math.dist(spot.position_ned, s.position_ned) for s in chosen]
        if min(distances) >= low and max(distances) <= high:
            chosen.append(spot)
        if len(chosen) == CANDIDATES:
            break
    if len(chosen) < CANDIDATES:
        return None
    pairs = [math.dist(a.position_ned, b.position_ned) for a, b in itertools.combinations(chosen, 2)]
    fits = min(pairs) <= NEAREST_PAIR_M[1] - SPARE_M and max(pairs) >= WIDEST_PAIR_M[0] + SPARE_M
    return chosen if fits else None


def _far_enough(middle: tuple[float, float], spots: list[Spot], asset: str) -> bool:
    """Return whether a fleet's place roughly keeps the required distances. The rules check the distances exactly."""
    ways = [math.dist(middle, s.position_ned[:2]) for s in spots]
    unread = READING_FOCAL_PX * LETTER_M.get(asset, PLATE_LETTER_M) / READABLE_PX  # m, unreadable beyond this
    bearings = [course(middle, s.position_ned) for s in spots]
    ahead = math.atan2(sum(map(math.sin, bearings)), sum(map(math.cos, bearings)))
    off = max(abs(math.degrees(math.remainder(b - ahead, 2.0 * math.pi))) for b in bearings)
    low = max(GRID_TO_CANDIDATES_M[0] + SPARE_M, unread + (1.0 if asset == "sign" else 0.0))
    return min(ways) >= low and max(ways) <= GRID_TO_CANDIDATES_M[1] - 1.0 and off <= HALF_VIEW_DEG


def _draft(
    site: Site,
    records: list[TargetRecord],
    candidates: list[Instance],
    middle: tuple[float, float],
    share: Draw,
    rng: random.Random,
) -> Proposal | None:
    """Return a draft with a fleet and four candidates.

    None if no yaw or no square of starts shows all candidates to all drones, or if no candidate can be the target. The
    target must be at an allowed distance, and the first drone must see it and have a clear way to it.
    """
    height = share.height_m(ALTITUDES_M)
    centre = (*middle, site.ground(*middle) - height)
    framings = [site.framed(candidate, centre) for candidate in candidates]
    yaw = yaw_showing_all(framings, [bearing_deg(centre, c.centre_ned) for c in candidates], share.turn)
    if yaw is None:
        return None
    first = candidates[0].centre_ned
    ahead = course(middle, first)
    for turned in rng.sample(TURNED_GRIDS_DEG, len(TURNED_GRIDS_DEG)):
        places = _grid(site, middle, ahead + math.radians(turned), (height, height))
        if any(not site.on_map(p[0], p[1]) or not site.free(p) for p in places):
            continue
        if any(_in_the_way(k, places, candidates, yaw) for k in range(len(places))):
            continue
        if all(site.seen(candidate, place, yaw) >= SEEN for candidate in candidates for place in places):
            break
    else:
        return None
    low, high = GRID_TO_TARGET_M
    near = [
        k
        for k, candidate in enumerate(candidates)
        if low + SPARE_M <= math.dist(middle, candidate.centre_ned[:2]) <= high - SPARE_M
        and site.seen(candidate, places[0], bearing_deg(places[0], candidate.centre_ned)) >= FACED
        and site.clear(places[0], candidate.centre_ned)
    ]
    if not near:
        return None
    named = rng.choice(near)
    target, lookalikes = records[named], tuple(record for k, record in enumerate(records) if k != named)
    words = inscribed(target.asset, str(target.inscription), rng)
    return Proposal(
        target=target,
        placed=candidates[named],
        starts=tuple(start(place, yaw) for place in places),
        visible=True,
        instruction=instruction("commanding", words, target.asset, rng),
        seed=flight_seed(rng),
        candidates=lookalikes,
    )


def _in_the_way(drone: int, places: list[Vec3], candidates: list[Instance], yaw_deg: float) -> bool:
    """Return whether another drone of the fleet covers more than HIDES of a candidate in a drone's picture."""
    yaw, lever = math.radians(yaw_deg), CAMERA.offset_frd[0]
    eye = (places[drone][0] + lever * math.cos(yaw), places[drone][1] + lever * math.sin(yaw))
    for place in (place for k, place in enumerate(places) if k != drone):
        way = course(eye, place)
        wide = math.asin(min(1.0, ABREAST_M / math.dist(eye, place[:2])))
        for candidate in candidates:
            corners = box_corners(candidate.mesh, candidate.position_ned, candidate.yaw)
            beside = [math.remainder(math.atan2(e - eye[1], n - eye[0]) - way, 2.0 * math.pi) for n, e, _ in corners]
            low, high = min(beside), max(beside)
            if high - low < math.pi and min(high, wide) - max(low, -wide) > HIDES * (high - low):
                return True
    return False


def _candidate(
    site: Site, asset: str, paint: str, text: str, spot: Spot, toward: float, rng: random.Random
) -> TargetRecord:
    """Return a candidate on a spot: a vehicle with its yaw, or a sign facing a viewer with the yaw `toward` (rad)."""
    north, east, _ = spot.position_ned
    yaw = math.degrees(spot.yaw)
    if asset == "sign":
        yaw = math.degrees(toward) + 180.0 + rng.uniform(-TURNED_DEG, TURNED_DEG)
    place = (round(north, 3), round(east, 3), round(site.ground(round(north, 3), round(east, 3)), 3))
    return TargetRecord(asset, paint, text, place, round(math.remainder(yaw, 360.0), 1))


def _grid(site: Site, middle: tuple[float, float], ahead: float, heights_m: tuple[float, float]) -> list[Vec3]:
    """Return the places (m, NED) of four drones in a level square: front left, front right, rear left, rear right.

    Their height above the ground under the square's middle is the mean of `heights_m`.
    """
    down = site.ground(*middle) - sum(heights_m) / 2.0
    c, s, half = math.cos(ahead), math.sin(ahead), GRID_SIDE_M / 2.0
    corners = itertools.product((half, -half), (-half, half))
    return [rounded((middle[0] + c * x - s * y, middle[1] + s * x + c * y, down)) for x, y in corners]
