"""Drones from one request, sent to as many things that look alike, to read which of them is meant.

Each drone flies to a thing of its own, reads it, and declares when it is the named one; when it is another, it stays
where it is and thinks. Nothing is remembered: which thing is a drone's own is read from its last action, which turned
its nose to it and whose depth says how far off it was.
"""

import math
from collections.abc import Sequence

from dronecats.pilots import reply
from dronecats.pilots.briefing import LEVEL_PX, PastAction
from dronecats.pilots.vision import alike, board_errand, division, inscription, plate_errand, reading, referent
from dronecats.pilots.vision.alike import LookAlike
from dronecats.pilots.vision.division import Spotted
from dronecats.pilots.vision.inscription import Inscription
from dronecats.pilots.vision.paint import Picture
from dronecats.pilots.vision.referent import Size
from foundation.protocol import GO, HISTORY_LENGTH, NEAR_M, ROTATE, STRIDE_MAX_M, THINK

Past = tuple[PastAction, ...]

# That a drone's own thing may have moved between two pictures: bearing, far and near, and logarithm of the distance
_ASIDE_RAD, _NEAR_ASIDE_RAD, _OFF = math.radians(4.0), math.radians(8.0), 0.3
_ROUND = 3.0  # times as much aside where the way leads round a vehicle
_OWN = 3.0  # of these, within which a thing is a drone's own
_NEAR_THING_M = 16.0  # from here on the way may lead past it
_BACK_DEG = 50.0  # a turn of this size looks for what was lost
_RESTS = 2  # after which one that has read a plate goes on: some vehicles are hidden from where all begin
_OTHER_M = 7.0  # what is nearer than this is the thing that was read
_LOST_M = 16.0  # what was near and is lost is no farther
_SHORT_OF_M = 6.0  # a thing is no farther when a short stride to it has ended, but for what its distance is wrong by
_WANDER_M = 8.0  # of a stride to somewhere else
_ON_DEG = 60.0  # a turn of this size says: that one was read, now another


def answer(pictures: Sequence[Picture], wanted: Inscription, command: str, past: Sequence[Past]) -> list[str]:
    """Return the next action of every drone, in picture order. Raises UsageError when nothing can be read here."""
    reading.ready()
    kind = referent.read(command.replace(" drone ", " "))
    under_way = any(past)
    views = alike.sightings(pictures, wanted, kind, (lambda k, view: own(view, past[k])) if under_way else None)
    if not under_way and len(pictures) == 1:
        return [_depart(chosen(views[0], inscription.place(command)))]
    if not under_way:
        return [_depart(spot) for spot in division.divide([[thing.spot for thing in view] for view in views])]
    all_done = all(settled(done) for done in past)
    return [
        reply.rotate(_ON_DEG) if all_done else _decide(picture, view, wanted, done, kind.size)
        for picture, view, done in zip(pictures, views, past, strict=True)
    ]


def chosen(view: Sequence[LookAlike], which: int | None) -> Spotted | None:
    """Return where a drone that flies alone goes first: to the thing in a place from the left, else to the nearest."""
    if not view:
        return None
    if which is not None and -len(view) <= which < len(view):
        return view[which].spot
    return min((thing.spot for thing in view), key=lambda spot: spot.distance_m)


def settled(past: Past, rests: int = HISTORY_LENGTH) -> bool:
    """Return whether a drone has read its thing and waited so long since, or has turned in vain all round."""
    kinds = {action.kind for action in past[-rests:]}
    return len(past) >= rests and kinds in ({THINK}, {ROTATE})


def going_on(past: Past) -> bool:
    """Return whether a drone looks for another thing than the one that it has read."""
    return bool(past) and past[-1].kind == ROTATE and abs(past[-1].angle_deg - _ON_DEG) < 0.5


def _depart(spot: Spotted | None) -> str:
    if spot is None or spot.ahead_m <= 0.0:
        return reply.rotate(_ON_DEG)
    return reply.go(500.0 + 500.0 * spot.right_m / spot.ahead_m, 500.0, max(spot.ahead_m, NEAR_M))


def _decide(picture: Picture, view: Sequence[LookAlike], wanted: Inscription, past: Past, size: Size) -> str:
    if past and past[-1].kind == THINK:
        return reply.rotate(_ON_DEG) if wanted.on_plate and settled(past, _RESTS) else reply.think()
    mine = own(view, past)
    if mine is None and going_on(past):
        in_vain = len(past) >= HISTORY_LENGTH and all(going_on((action,)) for action in past)
        return reply.go(500.0, 500.0, _WANDER_M) if in_vain else reply.rotate(_ON_DEG)
    if mine is None:
        if past and past[-1].kind == GO and past[-1].depth_m >= NEAR_M + STRIDE_MAX_M and past[-1].y_px == LEVEL_PX:
            return reply.go(500.0, 500.0, past[-1].depth_m - STRIDE_MAX_M)  # it is hidden, or too far to be told
        return plate_errand.lost(past) if wanted.on_plate and past else reply.rotate(_BACK_DEG)
    if wanted.on_plate:
        return plate_errand.decide(picture, mine, wanted, past, size)
    return board_errand.decide(picture, mine, wanted)


def own(view: Sequence[LookAlike], past: Past) -> LookAlike | None:
    """Return the thing that a drone was sent to, by what it did last; None when the picture does not show it."""
    if not view:
        return None
    if not past or past[-1].kind != GO:
        least, most = (_OTHER_M, math.inf) if going_on(past) else (0.0, _LOST_M)
        if settled(past):
            most = math.inf
        others = [thing for thing in view if least < thing.spot.distance_m < most]
        return min(others, key=lambda thing: thing.spot.distance_m) if others else None
    near_aside = _NEAR_ASIDE_RAD if past[-1].y_px == LEVEL_PX else _ROUND * _NEAR_ASIDE_RAD
    left = past[-1].depth_m - STRIDE_MAX_M
    short = left <= NEAR_M  # depths are chosen for the stride there

    def strangeness(thing: LookAlike) -> float:
        aside = abs(thing.spot.bearing_rad) / (_ASIDE_RAD if left > _NEAR_THING_M else near_aside)
        if short:
            return math.hypot(aside, max(0.0, math.log(max(thing.spot.ahead_m, 0.1) / _SHORT_OF_M)) / _OFF)
        off = math.log(max(thing.spot.ahead_m, 0.1) / left) / _OFF
        return math.hypot(aside, off)

    best = min(view, key=strangeness)
    return best if strangeness(best) <= _OWN else None
