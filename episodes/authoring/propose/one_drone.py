"""Drafts of episodes for one drone: targets with a colour of their own, and targets that their place tells apart.

On the residential map a target is placed and wears a paint that nothing else wears. On the campus it is one of many
alike, a fixture or something that moves, and the instruction tells it by where it stands.
"""

import itertools
import math
import random
from collections.abc import Generator, Iterator

from episodes.authoring.check import referring
from episodes.authoring.check.finding import OF_OTHER_MAPS, RULES
from episodes.authoring.check.placement import box_of
from episodes.authoring.check.referring import kind_of, nouns
from episodes.authoring.check.sight import CAMERA, bearing_deg
from episodes.authoring.propose.draft import Draw, Proposal, flight_seed, instruction, painted, yaw_deg
from episodes.authoring.propose.site import ALTITUDES_M, PlacedTarget, Site, rounded, start, stretch
from episodes.maps import assets
from episodes.maps.scene import Instance
from episodes.records.record import HIDDEN, MOVING, STATIONARY, Path3D, TargetRecord
from foundation.protocol import CAP_S

# Targets by their paint.
# No signs (for fleets), robots and carts (for the campus), and people, who are too small in the picture at 16 m
NOT_PAINTED = ("sign", "person", "pedestrian", "delivery_robot", "service_cart")
SPEED_MPS = 0.3  # on a map without a speed of its own
PAINTED_SPARE_M = 1.5  # of path beyond what the target covers
BAY_M = 0.25  # from a parked target to everything around it
REACH_M = 3.2  # from a target's middle towards the start: a drone hits a bus end-on before its middle is 5 m off
PAINTED_STARTS = 2  # drafts of one target, at most
# kinds of free place for an asset; everything else that drives stands at the kerb or on a drive
GROUNDS = {"bus": ("bus stop",), "quadrotor": ("lawn", "pavement"), "cyclist": ("kerb", "pavement")}
ANY_GROUND = ("kerb", "drive")
FOOTWAY = "pavement"  # in the name of a lane without vehicles

# Targets by their place.
NO_TARGETS = (*referring.UNNAMED, "clock-tower")  # kinds of a map that are never the target
MOVERS = ("delivery_robot", "service_cart", "pedestrian")
PAINT = "white"  # of what drives: the same that its look-alikes wear
REFERRED_SPARE_M = 1.0
ANYWHERE = ("nearest", "between")  # relations that hold wherever one stands, as needed for targets out of sight
BARREN = 4  # rounds through all kinds without a draft, after which the search ends
SKIPPED_NEAREST = 0.8  # of the targets that only nearness tells, so that others are tried
REFERRED_STARTS = 12  # tried before one target


def painted_drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield drafts without end, each for the share that is sent: assets and paints in turn, places at random."""
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
        for _ in range(12):  # places, until one has room for it
            target = _moving(site, asset, paint, rng) if moving else _parked(site, asset, paint, rng)
            drafts = list(itertools.islice(_around(site, cell, target, share, rng), PAINTED_STARTS)) if target else []
            for draft in drafts:
                previous = share
                share = yield draft
                if share != previous:  # the drafts left are for the previous record
                    break
            if drafts:
                break


def _parked(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a free spot; None when it does not fit there."""
    allowed = GROUNDS.get(asset, ANY_GROUND)
    spot = rng.choice([s for s in site.places.spots if s.place in allowed] or site.places.spots)
    yaw = round(math.degrees(spot.yaw), 1)
    target = TargetRecord(asset, paint, None, rounded(spot.position_ned), math.remainder(yaw, 360.0))
    instance = Instance(1, "target", asset, assets.build(asset, paint), spot.position_ned, math.radians(yaw))
    box = box_of(instance, instance.position_ned, instance.yaw, BAY_M, 0.12)
    return None if site.obstacles.overlapping(box) else target


def _moving(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a stretch of a lane; None when the lane is too short."""
    speed = RULES.get(site.name, OF_OTHER_MAPS).speed_mps or SPEED_MPS
    lane = rng.choice([lane for lane in site.places.lanes if FOOTWAY not in lane.name])
    length = speed * CAP_S + PAINTED_SPARE_M
    spare = lane.length_m - length
    if spare < 0.0:
        return None
    points = stretch(lane.waypoints_ned, rng.uniform(0.0, spare), length, site.scene.terrain)
    return TargetRecord(asset, paint, path=Path3D(points, speed))


def _around(site: Site, cell: str, target: TargetRecord, share: Draw, rng: random.Random) -> Iterator[Proposal]:
    placed = site.placed(target)
    low, high = RULES.get(site.name, OF_OTHER_MAPS).start_distance_m
    distance = (low + high) / 2 if high - low < 2.0 else low + 0.5 + share.distance * (min(high, 30.0) - low - 0.5)
    for place in site.starts(placed, distance, share.height_m(ALTITUDES_M), rng):
        ahead = bearing_deg(place, placed.centre_ned)
        if placed.reach_m(ahead) > REACH_M:
            continue
        yaw = yaw_deg(cell, ahead, site.framed(placed, place), share.turn)
        if yaw is not None:
            yield Proposal(
                target=target,
                placed=placed,
                starts=(start(place, yaw),),
                visible=cell not in HIDDEN,
                instruction=instruction(cell, painted(target.asset, str(target.paint)), target.asset, rng),
                seed=flight_seed(rng),
            )


def referred_drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield drafts without end, each for the share that is sent: kinds in turn, the rest at random."""
    if cell in MOVING:
        yield from _walking(site, cell, rng)
        return
    share = yield None
    fixtures: dict[str, list[Instance]] = {}
    for instance in site.scene.instances:
        if instance.solid and instance.kind not in NO_TARGETS:
            fixtures.setdefault(instance.kind, []).append(instance)
    kinds = [kind for kind in sorted(fixtures) if len(fixtures[kind]) > 1]
    rng.shuffle(kinds)
    barren = 0
    while kinds and barren < BARREN:
        barren += 1
        for kind in kinds:
            for instance in rng.sample(fixtures[kind], len(fixtures[kind])):
                target, placed = _native(instance), site.native(instance)
                draft = _before(site, cell, target, placed, instance.name, kind, share, rng)
                if draft is not None:
                    share, barren = (yield draft), 0
                    break


def _native(instance: Instance) -> TargetRecord:
    yaw = round(math.degrees(math.remainder(instance.yaw, 2.0 * math.pi)), 1)
    place = rounded(instance.position_ned)
    return TargetRecord(instance.kind, None, None, place, yaw, native=instance.name)


def _walking(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    share = yield None
    movers = list(MOVERS)
    speed = RULES.get(site.name, OF_OTHER_MAPS).speed_mps or 0.15
    length = speed * CAP_S + REFERRED_SPARE_M
    lanes = [lane for lane in site.places.lanes if lane.length_m > length]
    rng.shuffle(movers)
    barren = 0
    while movers and lanes and barren < BARREN:
        barren += 1
        for asset in movers:
            for _ in range(20):
                lane = rng.choice(lanes)
                first = rng.uniform(0.0, lane.length_m - length)
                path = Path3D(stretch(lane.waypoints_ned, first, length, site.scene.terrain), speed)
                paint = rng.choice(assets.PAINTS) if asset == "pedestrian" else PAINT
                target = TargetRecord(asset, paint, path=path)
                draft = _before(site, cell, target, site.placed(target), "target", kind_of(asset), share, rng)
                if draft is not None:
                    share, barren = (yield draft), 0
                    break


def _before(
    site: Site,
    cell: str,
    target: TargetRecord,
    placed: PlacedTarget,
    name: str,
    kind: str,
    share: Draw,
    rng: random.Random,
) -> Proposal | None:
    """Return a draft of a start before a target that an expression denotes; None when there is none.

    The distance is the share's: of the map's whole range for a target that stands, of the range that its size allows
    for one that moves. A relation is drawn first, so that they are not all 'nearest', which is the last choice.
    """
    rules = RULES.get(site.name, OF_OTHER_MAPS)
    nearest, farthest = rules.start_distance_m[0] + 0.2, rules.start_distance_m[1] - 0.3
    if cell in MOVING:  # all that moves is small
        farthest = min(farthest, farthest_m(placed, rules.occupancy_percent[0]))
    distance = nearest + share.distance * (farthest - nearest)
    if not nearest <= distance <= farthest_m(placed, rules.occupancy_percent[0]):
        return None
    places = {i.name: i.position_ned for i in site.scene.instances if i.kind == kind} | {name: placed.position_ned}
    hidden = cell in HIDDEN
    drawn = rng.choice(ANYWHERE if hidden else referring.RELATIONS)
    best: tuple[int, Proposal] | None = None
    starts = site.starts(placed, distance, share.height_m(ALTITUDES_M), rng, rules.off_axes_deg)
    for spot in itertools.islice(starts, REFERRED_STARTS):
        yaw = yaw_deg(cell, bearing_deg(spot, placed.centre_ned), site.framed(placed, spot), share.turn)
        if yaw is None:
            continue
        pose = start(spot, yaw)
        marks = referring.landmarks(site.name, site.seed, kind, spot, None if hidden else pose.yaw_deg)
        expressions = referring.expressions(nouns(kind)[0], name, places, marks, spot)
        expressions = [e for e in expressions if not hidden or e.relation in ANYWHERE]
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


def farthest_m(placed: PlacedTarget, percent: float) -> float:
    """Return the distance from which a target can fill this share of the picture, seen from its broad side."""
    wide, high = placed.size_m
    least = percent / 100.0 * CAMERA.width * CAMERA.height
    return CAMERA.focal_px * math.sqrt(wide * high / least)
