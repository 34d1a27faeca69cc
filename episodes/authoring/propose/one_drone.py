"""Drafts of episodes for one drone. The instruction identifies the target by its paint or by its place.

On a map without landmarks, such as the residential map, the target is placed on the map, in a paint that no other asset
has. On a map with landmarks, such as the campus, the target is one of several similar things: a fixture of the map, or
a moving asset. The instruction then names the target's place relative to landmarks.
"""

import itertools
import math
import random
from collections.abc import Callable, Generator, Iterator
from functools import partial

import numpy as np

from episodes.authoring.check import referring
from episodes.authoring.check.finding import DEFAULT_RULES, RULES
from episodes.authoring.check.placement import box_of
from episodes.authoring.check.referring import kind_of, nouns
from episodes.authoring.check.sight import CAMERA, box_corners
from episodes.authoring.propose.draft import Draw, Proposal, flight_seed, instruction, yaw_deg
from episodes.authoring.propose.site import ALTITUDES_M, Site, rounded, start, stretch
from episodes.maps import assets
from episodes.maps.scene import Instance
from episodes.records.record import HIDDEN, MOVING, STATIONARY, Path3D, TargetRecord
from foundation.frames import bearing_deg, vec3
from foundation.protocol import CAP_S

# Targets that the instruction identifies by paint

# assets that are never targets here: signs are only for fleets; robots and carts are only for the campus; people are
# too small at 16 m
NOT_PAINTED = ("sign", "person", "pedestrian", "delivery_robot", "service_cart")
SPEED_MPS = 0.3  # speed of a target on a map that requires no speed
PAINTED_SPARE_M = 1.5  # length of the path beyond the distance that the target covers in an episode
BAY_M = 0.25  # the free space around a parked target is at least this wide
# m, largest reach of a target from its middle towards the start. A drone that approaches the end of a longer target,
# such as a bus, would hit the bus before it is within 5 m of the bus's middle.
REACH_M = 3.2
PAINTED_STARTS = 2  # at most this many starts (drafts) for one target
# kinds of spots for an asset; an asset without an entry gets ANY_GROUND
GROUNDS = {"bus": ("bus stop",), "quadrotor": ("lawn", "pavement"), "cyclist": ("kerb", "pavement")}
ANY_GROUND = ("kerb", "drive")
FOOTWAY = "pavement"  # lanes without vehicles have this word in their names

# Targets that the instruction identifies by place
NO_TARGETS = (*referring.UNNAMED, "clock-tower")  # kinds of a map that are never the target
MOVERS = ("delivery_robot", "service_cart", "pedestrian")
PAINT = "white"  # paint of moving robots and carts, like those that belong to the map
REFERRED_SPARE_M = 1.0  # like PAINTED_SPARE_M
VIEW_INDEPENDENT_RELATIONS = ("nearest", "between")  # true from every place of the viewer, so they suit hidden targets
EMPTY_ROUNDS_MAX = 4  # after this many rounds through all kinds without a draft, the search ends
SKIPPED_NEAREST = 0.8  # probability of skipping a target that only `nearest` identifies, to try other targets
REFERRED_STARTS = 12  # at most this many starts are tried for one target


def painted_drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield None, then a draft for each `Draw` (random shares) sent in. Assets and paints take turns.

    End at once if the map has no place for a target: no spot or, for a `cell` (kind of episode) with moving targets, no
    lane for vehicles.
    """
    share = yield None
    moving = cell in MOVING
    kinds = [name for name in assets.names() if name not in NOT_PAINTED and not (moving and name in STATIONARY)]
    paints = site.free_paints() or list(assets.PAINTS)
    if not ([n for n in site.places.lanes if FOOTWAY not in n.name] if moving else site.places.spots):
        return
    rng.shuffle(kinds)
    rng.shuffle(paints)
    for turn, asset in enumerate(itertools.cycle(kinds)):
        paint = paints[turn % len(paints)]
        for _ in range(12):  # attempts to find a place with room for the target
            target = _moving(site, asset, paint, rng) if moving else _parked(site, asset, paint, rng)
            if target is None:
                continue
            drafts = list(itertools.islice(_painted_starts(site, cell, target, share, rng), PAINTED_STARTS))
            for draft in drafts:
                previous = share
                share = yield draft
                if share != previous:  # a new draw: the caller has gone on to another record
                    break
            if drafts:
                break


def _parked(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a free spot; None if it does not fit there."""
    allowed = GROUNDS.get(asset, ANY_GROUND)
    spot = rng.choice([s for s in site.places.spots if s.place in allowed] or site.places.spots)
    yaw = round(math.degrees(spot.yaw), 1)
    target = TargetRecord(asset, paint, None, rounded(spot.position_ned), math.remainder(yaw, 360.0))
    box = box_of(assets.build(asset, paint), spot.position_ned, math.radians(yaw), BAY_M, 0.12)
    return None if site.obstacles.overlapping(box) else target


def _moving(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a stretch of a lane; None if the lane is too short."""
    speed = RULES.get(site.name, DEFAULT_RULES).speed_mps or SPEED_MPS
    lane = rng.choice([lane for lane in site.places.lanes if FOOTWAY not in lane.name])
    length = speed * CAP_S + PAINTED_SPARE_M
    spare = lane.length_m - length
    if spare < 0.0:
        return None
    points = stretch(lane.waypoints_ned, rng.uniform(0.0, spare), length, site.scene.terrain)
    return TargetRecord(asset, paint, path=Path3D(points, speed))


def _painted_starts(site: Site, cell: str, target: TargetRecord, share: Draw, rng: random.Random) -> Iterator[Proposal]:
    placed = site.placed(target)
    low, high = RULES.get(site.name, DEFAULT_RULES).start_distance_m
    distance = (low + high) / 2 if high - low < 2.0 else low + 0.5 + share.distance * (min(high, 30.0) - low - 0.5)
    for place in site.starts(placed, distance, share.height_m(ALTITUDES_M), rng):
        ahead = bearing_deg(place, placed.centre_ned)
        if _reach_m(placed, ahead) > REACH_M:
            continue
        yaw = yaw_deg(cell, ahead, site.framed(placed, place), share.turn)
        if yaw is not None:
            yield Proposal(
                target=target,
                placed=placed,
                starts=(start(place, yaw),),
                visible=cell not in HIDDEN,
                instruction=instruction(cell, f"the {target.paint} {nouns(target.asset)[0]}", target.asset, rng),
                seed=flight_seed(rng),
            )


def _reach_m(placed: Instance, bearing_deg: float) -> float:
    """Return how far (m) a target reaches from its middle towards a viewer who looks along a compass bearing."""
    corners = box_corners(placed.mesh, placed.position_ned, placed.yaw)[:, :2] - np.array(placed.centre_ned[:2])
    way = math.radians(bearing_deg)
    return float(-(corners @ np.array([math.cos(way), math.sin(way)])).min())


def referred_drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield None, then a draft for each `Draw` sent in. Kinds take turns, and other values are random."""
    share = yield None
    kinds = _movers(site, rng) if cell in MOVING else _natives(site, rng)
    barren = 0
    while kinds and barren < EMPTY_ROUNDS_MAX:
        barren += 1
        for targets in kinds:
            for target in targets():
                draft = _referred_draft(site, cell, target, share, rng)
                if draft is not None:
                    share, barren = (yield draft), 0
                    break


def _natives(site: Site, rng: random.Random) -> list[Callable[[], Iterator[TargetRecord]]]:
    """Return for each kind of fixture, in random order, a function that yields its instances in random order."""
    fixtures: dict[str, list[Instance]] = {}
    for instance in site.scene.instances:
        if instance.solid and instance.kind not in NO_TARGETS:
            fixtures.setdefault(instance.kind, []).append(instance)
    kinds = [kind for kind in sorted(fixtures) if len(fixtures[kind]) > 1]
    rng.shuffle(kinds)

    def targets(instances: list[Instance]) -> Iterator[TargetRecord]:
        for instance in rng.sample(instances, len(instances)):
            yaw = round(math.degrees(math.remainder(instance.yaw, 2.0 * math.pi)), 1)
            yield TargetRecord(instance.kind, None, None, rounded(instance.position_ned), yaw, native=instance.name)

    return [partial(targets, fixtures[kind]) for kind in kinds]


def _movers(site: Site, rng: random.Random) -> list[Callable[[], Iterator[TargetRecord]]]:
    """Return for each of MOVERS, in random order, a function that yields targets on random stretches of lanes."""
    movers = list(MOVERS)
    speed = RULES.get(site.name, DEFAULT_RULES).speed_mps or 0.15
    length = speed * CAP_S + REFERRED_SPARE_M
    lanes = [lane for lane in site.places.lanes if lane.length_m > length]
    rng.shuffle(movers)

    def targets(asset: str) -> Iterator[TargetRecord]:
        for _ in range(20):
            lane = rng.choice(lanes)
            first = rng.uniform(0.0, lane.length_m - length)
            path = Path3D(stretch(lane.waypoints_ned, first, length, site.scene.terrain), speed)
            paint = rng.choice(assets.PAINTS) if asset == "pedestrian" else PAINT
            yield TargetRecord(asset, paint, path=path)

    return [partial(targets, asset) for asset in movers if lanes]


def _referred_draft(site: Site, cell: str, target: TargetRecord, share: Draw, rng: random.Random) -> Proposal | None:
    """Return a draft with a start from which an expression denotes only the target; None if there is no such start.

    `share` sets the start distance within the map's range. For a moving target, the range ends where the target is too
    small in the picture. A randomly drawn relation is preferred. 'nearest' is the last choice, and is often skipped.
    """
    placed, name, kind = site.placed(target), target.native or "target", kind_of(target.asset)
    rules = RULES.get(site.name, DEFAULT_RULES)
    nearest, farthest = rules.start_distance_m[0] + 0.2, rules.start_distance_m[1] - 0.3
    if cell in MOVING:  # moving targets are small; beyond this, every draw would fail
        farthest = min(farthest, farthest_m(placed, rules.occupancy_percent[0]))
    distance = nearest + share.distance * (farthest - nearest)
    if not nearest <= distance <= farthest_m(placed, rules.occupancy_percent[0]):
        return None
    places = {i.name: i.position_ned for i in site.scene.instances if i.kind == kind} | {name: placed.position_ned}
    hidden = cell in HIDDEN
    drawn = rng.choice(VIEW_INDEPENDENT_RELATIONS if hidden else referring.RELATIONS)
    best: tuple[int, Proposal] | None = None
    starts = site.starts(placed, distance, share.height_m(ALTITUDES_M), rng, rules.off_axes_deg)
    for spot in itertools.islice(starts, REFERRED_STARTS):
        yaw = yaw_deg(cell, bearing_deg(spot, placed.centre_ned), site.framed(placed, spot), share.turn)
        if yaw is None:
            continue
        pose = start(spot, yaw)
        marks = referring.landmarks(site.name, site.seed, kind, spot, None if hidden else pose.yaw_deg)
        expressions = referring.expressions(nouns(kind)[0], name, places, marks, spot)
        expressions = [e for e in expressions if not hidden or e.relation in VIEW_INDEPENDENT_RELATIONS]
        for expression in rng.sample(expressions, len(expressions)):
            worth = 2 if expression.relation == drawn else int(expression.relation != "nearest")
            if best is None or worth > best[0]:
                words = instruction(cell, expression.words, kind, rng)
                best = (worth, Proposal(target, placed, (pose,), not hidden, words, flight_seed(rng)))
        if best and best[0] == 2:
            return best[1]
    if best and best[0] == 0 and rng.random() < SKIPPED_NEAREST:
        return None
    return best[1] if best else None


def farthest_m(placed: Instance, percent: float) -> float:
    """Return the largest distance at which a target, seen from its broad side, can fill `percent` of the picture."""
    length, width, high = vec3(placed.mesh.vertices.max(axis=0) - placed.mesh.vertices.min(axis=0))
    least = percent / 100.0 * CAMERA.width * CAMERA.height
    return CAMERA.focal_px * math.sqrt(max(length, width) * high / least)
