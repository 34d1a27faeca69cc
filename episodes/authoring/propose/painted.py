"""Targets that are placed and wear a colour of their own, as on the residential map."""

import itertools
import math
import random
from collections.abc import Generator, Iterator

from episodes.authoring.check.finding import OF_OTHER_MAPS, RULES
from episodes.authoring.check.placement import box_of
from episodes.authoring.check.sight import bearing_deg
from episodes.authoring.propose.draft import Draw, Proposal, flight_seed, instruction, painted, yaw_deg
from episodes.authoring.propose.site import ALTITUDES_M, Site, start, stretch
from episodes.maps import assets
from episodes.maps.scene import Instance
from episodes.records.record import MOVING, STANDING, Path3D, TargetRecord
from foundation.protocol import CAP_S

# boards are for fleets, robots and carts for the campus, and people are too small in the picture at 16 m
NOT_HERE = ("sign", "person", "pedestrian", "delivery_robot", "service_cart")
SPEED_MPS = 0.3  # where the map does not say
SPARE_M = 1.5  # of path beyond what the target covers
BAY_M = 0.25  # kept to everything by a parked target
REACH_M = 3.2  # from a target's middle towards the start: a bus end-on is run into before its middle is 5 m off
STARTS = 2  # drafts of one target, at most

# what kinds of free place an asset may be found on; everything else that drives stands at the kerb or on a drive
GROUNDS = {"bus": ("bus stop",), "quadrotor": ("lawn", "pavement"), "cyclist": ("kerb", "pavement")}
ANY_GROUND = ("kerb", "drive")
FOOTWAY = "pavement"  # in the name of a lane that nothing with wheels takes


def drafts(site: Site, cell: str, rng: random.Random) -> Generator[Proposal | None, Draw, None]:
    """Yield drafts without end, each for the share that is sent: assets and paints in turn, places at random."""
    share = yield None
    moving = cell in MOVING
    kinds = [name for name in assets.names() if name not in NOT_HERE and not (moving and name in STANDING)]
    paints = site.free_paints() or list(assets.PAINTS)
    if not ([n for n in site.places.lanes if FOOTWAY not in n.name] if moving else site.places.spots):
        return
    rng.shuffle(kinds)
    rng.shuffle(paints)
    for turn, asset in enumerate(itertools.cycle(kinds)):
        paint = paints[turn % len(paints)]
        for _ in range(12):  # places, until one has room for it
            target = _moving(site, asset, paint, rng) if moving else _parked(site, asset, paint, rng)
            made = list(itertools.islice(_around(site, cell, target, share, rng), STARTS)) if target else []
            for one in made:
                asked = share
                share = yield one
                if share != asked:  # the others are for the record before
                    break
            if made:
                break


def _parked(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a free spot; None when it does not fit there."""
    allowed = GROUNDS.get(asset, ANY_GROUND)
    spot = rng.choice([s for s in site.places.spots if s.place in allowed] or site.places.spots)
    n, e, d = spot.position_ned
    yaw = round(math.degrees(spot.yaw), 1)
    target = TargetRecord(asset, paint, None, (round(n, 3), round(e, 3), round(d, 3)), math.remainder(yaw, 360.0))
    mesh = assets.build(asset, paint)
    one = Instance(1, "target", asset, mesh, spot.position_ned, math.radians(yaw))
    return None if site.standing.met(box_of(one, one.position_ned, one.yaw, BAY_M, 0.12)) else target


def _moving(site: Site, asset: str, paint: str, rng: random.Random) -> TargetRecord | None:
    """Return a target on a stretch of a lane; None when the lane is too short."""
    speed = RULES.get(site.name, OF_OTHER_MAPS).speed_mps or SPEED_MPS
    lane = rng.choice([lane for lane in site.places.lanes if FOOTWAY not in lane.name])
    spare = lane.length_m - (speed * CAP_S + SPARE_M)
    if spare < 0.0:
        return None
    points = stretch(lane.waypoints_ned, rng.uniform(0.0, spare), speed * CAP_S + SPARE_M, site.scene.terrain)
    return TargetRecord(asset, paint, path=Path3D(points, speed))


def _around(site: Site, cell: str, target: TargetRecord, share: Draw, rng: random.Random) -> Iterator[Proposal]:
    thing = site.placed(target)
    low, high = RULES.get(site.name, OF_OTHER_MAPS).start_distance_m
    distance = (low + high) / 2 if high - low < 2.0 else low + 0.5 + share.distance * (min(high, 30.0) - low - 0.5)
    height = ALTITUDES_M[0] + share.height * (ALTITUDES_M[1] - ALTITUDES_M[0])
    for place in site.starts(thing, distance, height, rng):
        if thing.reach_m(bearing_deg(place, thing.centre_ned)) > REACH_M:
            continue
        yaw = yaw_deg(cell, bearing_deg(place, thing.centre_ned), site.framed(thing, place), share.turn)
        if yaw is None:
            continue
        yield Proposal(
            target=target,
            place_ned=thing.position_ned,
            goal_ned=thing.centre_ned,
            starts=(start(place, yaw),),
            visible=cell in ("approaching", "tracking"),
            instruction=instruction(cell, painted(target.asset, str(target.paint)), target.asset, rng),
            seed=flight_seed(rng),
        )
