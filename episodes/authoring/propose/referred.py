"""Targets among near-duplicates, told by where they stand, as on the campus: its fixtures, or what moves among them."""

import itertools
import math
import random
from collections.abc import Generator

from episodes.authoring.check import referring
from episodes.authoring.check.finding import OF_OTHER_MAPS, RULES
from episodes.authoring.check.referring import kind_of, nouns
from episodes.authoring.check.sight import CAMERA, bearing_deg
from episodes.authoring.propose.draft import Draw, Proposal, flight_seed, instruction, yaw_deg
from episodes.authoring.propose.site import ALTITUDES_M, PlacedTarget, Site, start, stretch
from episodes.maps import assets
from episodes.maps.scene import Instance
from episodes.records.record import HIDDEN, MOVING, Path3D, TargetRecord
from foundation.protocol import CAP_S

# kinds of a map that no episode has as its target
NO_TARGETS = (*referring.UNNAMED, "clock-tower")
MOVERS = ("delivery_robot", "service_cart", "pedestrian")
PAINT = "white"  # of what drives: the same that its look-alikes wear
SPARE_M = 1.0
ANYWHERE = ("nearest", "between")  # relations that hold wherever one stands: what is out of sight is told by these
BARREN = 4  # rounds through all kinds without a draft, after which there is none to be had
NEARER_SAID = 0.8  # of the things that only nearness tells are passed over
STARTS = 12  # looked at before one thing


def drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield drafts without end, each for the share that is sent: kinds in turn, things, starts and words at random."""
    if cell in MOVING:
        yield from _walking(site, cell, rng)
        return
    share = yield None
    fixtures: dict[str, list[Instance]] = {}
    for one in site.scene.instances:
        if one.solid and one.kind not in NO_TARGETS:
            fixtures.setdefault(one.kind, []).append(one)
    kinds = [kind for kind in sorted(fixtures) if len(fixtures[kind]) > 1]
    rng.shuffle(kinds)
    barren = 0
    while kinds and barren < BARREN:
        barren += 1
        for kind in kinds:
            for one in rng.sample(fixtures[kind], len(fixtures[kind])):
                made = _before(site, cell, _native(one), site.native(one), one.name, kind, share, rng)
                if made is not None:
                    share, barren = (yield made), 0
                    break


def _native(one: Instance) -> TargetRecord:
    n, e, d = one.position_ned
    yaw = round(math.degrees(math.remainder(one.yaw, 2.0 * math.pi)), 1)
    return TargetRecord(one.kind, None, None, (round(n, 3), round(e, 3), round(d, 3)), yaw, native=one.name)


def _walking(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    share = yield None
    movers = list(MOVERS)
    speed = RULES.get(site.name, OF_OTHER_MAPS).speed_mps or 0.15
    need = speed * CAP_S + SPARE_M
    lanes = [lane for lane in site.places.lanes if lane.length_m > need]
    rng.shuffle(movers)
    barren = 0
    while movers and lanes and barren < BARREN:
        barren += 1
        for asset in movers:
            for _ in range(20):
                lane = rng.choice(lanes)
                first = rng.uniform(0.0, lane.length_m - need)
                path = Path3D(stretch(lane.waypoints_ned, first, need, site.scene.terrain), speed)
                paint = rng.choice(assets.PAINTS) if asset == "pedestrian" else PAINT
                target = TargetRecord(asset, paint, path=path)
                made = _before(site, cell, target, site.placed(target), "target", kind_of(asset), share, rng)
                if made is not None:
                    share, barren = (yield made), 0
                    break


def _before(
    site: Site,
    cell: str,
    target: TargetRecord,
    thing: PlacedTarget,
    name: str,
    kind: str,
    share: Draw,
    rng: random.Random,
) -> Proposal | None:
    """Return a draft of a start before a thing from which words can tell it; None when none is found.

    The distance is the share's, of the map's whole range for what stands and of what it is large enough for where it
    moves. A relation is drawn first and looked for, so that they are not all 'nearest', which is the last choice.
    """
    rules = RULES.get(site.name, OF_OTHER_MAPS)
    nearest, farthest = rules.start_distance_m[0] + 0.2, rules.start_distance_m[1] - 0.3
    if cell in MOVING:  # all that moves is small
        farthest = min(farthest, farthest_m(thing, rules.occupancy_percent[0]))
    distance = nearest + share.distance * (farthest - nearest)
    if not nearest <= distance <= farthest_m(thing, rules.occupancy_percent[0]):
        return None
    height = ALTITUDES_M[0] + share.height * (ALTITUDES_M[1] - ALTITUDES_M[0])
    things = {i.name: i.position_ned for i in site.scene.instances if i.kind == kind}
    things[name] = thing.position_ned
    hidden = cell in HIDDEN
    asked = rng.choice(ANYWHERE if hidden else tuple(referring.WORDS))
    best: tuple[int, Proposal] | None = None
    for place in itertools.islice(site.starts(thing, distance, height, rng, rules.off_axes_deg), STARTS):
        yaw = yaw_deg(cell, bearing_deg(place, thing.centre_ned), site.framed(thing, place), share.turn)
        if yaw is None:
            continue
        one = start(place, yaw)
        marks = referring.landmarks(site.name, site.seed, kind, place, None if hidden else one.yaw_deg)
        found = referring.expressions(nouns(kind)[0], name, things, marks, place)
        found = [f for f in found if not hidden or f.relation in ANYWHERE]
        for said in rng.sample(found, len(found)):
            worth = 2 if said.relation == asked else int(said.relation != "nearest")
            if best is None or worth > best[0]:
                draft = Proposal(
                    target=target,
                    place_ned=thing.position_ned,
                    goal_ned=thing.centre_ned,
                    starts=(one,),
                    visible=not hidden,
                    instruction=instruction(cell, said.words, kind, rng),
                    seed=flight_seed(rng),
                )
                best = (worth, draft)
        if best and best[0] == 2:
            return best[1]
    if best and best[0] == 0 and rng.random() < NEARER_SAID:  # another thing may have more to be told by
        return None
    return best[1] if best else None


def farthest_m(thing: PlacedTarget, percent: float) -> float:
    """Return from how far a thing can fill so many percent of the picture, from its broad side."""
    wide, high = thing.size_m
    least = percent / 100.0 * CAMERA.width * CAMERA.height
    return CAMERA.focal_px * math.sqrt(wide * high / least)
