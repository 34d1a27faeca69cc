"""Going to a thing that is told by where it stands.

Each picture is looked at anew. What was gone for before is read in the history: after a `go` the thing lies straight
ahead, as much nearer as the stride was long. Where the landmark has no shape that is known, as a hall, every thing of
the kind may be the one: then one after the other is visited and claimed.
"""

import math
import zlib
from collections.abc import Iterable

from dronecats.pilots import reply
from dronecats.pilots.briefing import PastAction
from dronecats.pilots.vision import expression, ranging, relation, search, shapes, standing
from dronecats.pilots.vision.expression import ToldByPlace
from dronecats.pilots.vision.paint import Picture
from dronecats.pilots.vision.standing import PlacedThing
from foundation.protocol import FINISHED, GO, NEAR_M, NEAR_SCALE, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M

_CIRCLE = 5  # turns of a sweep after which everything around has been seen
_CLAIM_M = 4.6  # from the body, in plan; the verifier's radius is 5 m in space
_STOP_M = 4.1  # where strides are meant to end
_CLOSER_M = 3.4  # farther off than this a second claim is made from nearer, past the thing's own half width
_CAREFUL_M = 9.0  # within this, only short strides
_SURE, _LIKELY = 0.3, -0.9  # logarithm of the odds from which a thing is gone for, and is still the one gone for
_FOLLOWS_DEG, _FOLLOWS_M = 8.0, 1.8  # off the nose, within which what was gone for is looked for
_RATIO = 0.45  # logarithm, of distances, likewise
_MARK_BONUS = 0.7  # a landmark need not be as sure as what is gone for
_WEIGHT = 7.0  # of a relation that holds, as logarithm of odds
_VISITED_M = 6.5  # what stands nearer than this is not gone for anew
_LEAVE_DEG = 75.0  # turned away from what was claimed
_ASIDE_DEG = 44.0  # off the way to what stands behind an obstacle
_BLOCKED_AFTER = 3  # strides that bring nothing nearer
_SHORTEST_M = STRIDE_MIN_M / NEAR_SCALE + 0.01
_ALIKE = {"fountain": ("fountain", "tiered-fountain")}  # words that mean more than one kind


def decide(picture: Picture, told: ToldByPlace, past: tuple[PastAction, ...]) -> str:
    """Return the action for one picture, given what is looked for and what was done before."""
    kinds = _kinds(told.kind)
    marks = {kind for one in told.landmarks if one.kind for kind in _kinds(one.kind)}
    things = standing.find(picture, sorted({*kinds, *marks}), shapes.network())
    wanted = [t for t in things if t.kind in kinds]
    if past and past[-1].kind == FINISHED:
        return _after_claim(picture, wanted, past)
    if past and past[-1].kind == GO and not search.wanders(past):
        return _follow(picture, wanted, past, told, things)
    return _choose(picture, wanted, past, told, things)


def _kinds(kind: str) -> tuple[str, ...]:
    return _ALIKE.get(kind, (kind,))


def _away_m(thing: PlacedThing) -> float:
    """Return how far (m) a thing is from the body, in plan."""
    return math.hypot(thing.depth_m + ranging.CAMERA_AHEAD_M, thing.right_m)


def _after_claim(picture: Picture, wanted: list[PlacedThing], past: tuple[PastAction, ...]) -> str:
    """Come closer once and claim again; after that, turn away."""
    again = len(past) > 1 and past[-2].kind == GO and past[-2].depth_m <= _SHORTEST_M + 0.1
    here = [t for t in wanted if _away_m(t) < _VISITED_M and abs(t.right_m) < _FOLLOWS_M]
    if not again and here:
        nearest = min(here, key=_away_m)
        if _away_m(nearest) - standing.half_width_m(nearest.kind) > _CLOSER_M - 0.6:
            return _go(nearest, _SHORTEST_M)
    return reply.rotate(math.copysign(_LEAVE_DEG, _lot(picture) % 2 - 0.5))


def _lot(picture: Picture) -> int:
    """Return a number that is another one for another picture: a tour by lot does not go round in a circle."""
    return zlib.crc32(picture[::4, ::4].tobytes())


def _follow(
    picture: Picture,
    wanted: list[PlacedThing],
    past: tuple[PastAction, ...],
    told: ToldByPlace,
    things: list[PlacedThing],
) -> str:
    """Go on to what was gone for, where it is still seen or must be near."""
    last = past[-1]
    stride = STRIDE_MAX_M if last.depth_m >= NEAR_M else NEAR_SCALE * last.depth_m
    expected = max(last.depth_m - stride, 3.0) if last.depth_m >= NEAR_M else _CLAIM_M
    if len(past) > 1 and past[-2].kind == FINISHED and last.depth_m <= _SHORTEST_M + 0.1:
        return reply.finished()
    reach = max(math.radians(_FOLLOWS_DEG), math.atan(_FOLLOWS_M / expected))
    near = [
        t
        for t in wanted
        if t.odds >= _LIKELY
        and abs(math.atan2(t.right_m, t.depth_m)) < reach
        and abs(math.log(t.depth_m / expected)) < _RATIO
    ]
    if near:
        one = max(near, key=lambda t: t.odds - 3.0 * abs(math.log(t.depth_m / expected)))
        away = 0.6 * _away_m(one) + 0.4 * (expected + ranging.CAMERA_AHEAD_M)
        return _round(picture) if _blocked(past, away) else _approach(one, away)
    if expected <= _CLAIM_M:
        return reply.finished()
    if expected <= _CAREFUL_M:
        return _go(PlacedThing(told.kind, expected, 0.0, 0.0, 0.0), _depth_for(expected + ranging.CAMERA_AHEAD_M))
    return _choose(picture, wanted, past, told, things)


def _blocked(past: tuple[PastAction, ...], away_m: float) -> bool:
    """Return whether the last strides towards what is `away_m` off have brought it no nearer than one would."""
    strides = past[-_BLOCKED_AFTER:]
    if len(strides) < _BLOCKED_AFTER or any(p.kind != GO or p.depth_m < NEAR_M for p in strides):
        return False
    return away_m > strides[0].depth_m - 0.5 * _BLOCKED_AFTER * STRIDE_MAX_M


def _round(picture: Picture) -> str:
    """Return a stride past an obstacle, on the side where the view is more open."""
    u, _ = search.way_out(picture)
    side = math.copysign(math.tan(math.radians(_ASIDE_DEG)), u - 500.0)
    return reply.go(500.0 + 500.0 * max(-0.99, min(0.99, side)), 500.0, search.WANDER_M)


def _choose(
    picture: Picture,
    wanted: list[PlacedThing],
    past: tuple[PastAction, ...],
    told: ToldByPlace,
    things: list[PlacedThing],
) -> str:
    """Go for the thing that is most likely meant; look on where none is."""
    # no episode begins so near to its target: what is here now was come to, and claimed or passed by
    open_to = [t for t in wanted if not (past and _away_m(t) < _VISITED_M)]
    turns = search.trailing(past, ROTATE)
    ranked = sorted(((_worth(t, told, things), t) for t in open_to), key=lambda pair: -pair[0])
    # what is to be looked for is not in the first picture; it is told by its landmark, so without that the first circle
    # is closed before another thing of its kind will do
    first_circle = told.sought and turns == len(past) and turns < _CIRCLE
    least = _SURE + 0.3 * _WEIGHT if first_circle and all(one.kind for one in told.landmarks) else _SURE
    if not past and not told.sought:  # what is only to be gone to is in the first picture, however unsure
        least = standing.LEAST
    if ranked and ranked[0][0] >= least and not (told.sought and not past):
        alike = [t for worth, t in ranked if worth >= least]
        toured = told.sought and not all(one.kind for one in told.landmarks)
        best = alike[_lot(picture) % len(alike)] if toured else ranked[0][1]
        return _approach(best, _away_m(best))
    marks = [t for t in things if t.kind in {k for one in told.landmarks if one.kind for k in _kinds(one.kind)}]
    far = [t for t in marks if t.odds >= _SURE and _away_m(t) > 2.0 * _VISITED_M]
    if turns and far and not wanted:
        best = max(far, key=lambda t: t.odds)
        return _go(best, search.WANDER_M)
    return search.search(picture, past)


def _worth(one: PlacedThing, told: ToldByPlace, things: Iterable[PlacedThing]) -> float:
    """Return how likely a thing is the one that is told, as a logarithm of odds."""
    marks = [
        [t for t in things if mark.kind and t.kind in _kinds(mark.kind) and t is not one] for mark in told.landmarks
    ]
    if not all(marks):
        return one.odds
    others = [_place(t) for t in things if t.kind in _kinds(told.kind) and t is not one and t.odds >= _SURE]
    best = 0.0
    pairs = (
        [(a, b) for a in marks[0] for b in marks[1]]
        if told.relation == expression.BETWEEN
        else [(a,) for a in marks[0]]
    )
    for pair in pairs:
        sure = min(1.0 / (1.0 + math.exp(-t.odds - _MARK_BONUS)) for t in pair)
        best = max(best, sure * relation.fit(told.relation, _place(one), [_place(t) for t in pair], others))
    return min(one.odds, 6.0) + _WEIGHT * best


def _place(thing: PlacedThing) -> relation.FloorPoint:
    return thing.right_m, thing.depth_m


def _approach(thing: PlacedThing, away_m: float) -> str:
    """Claim a thing that is near enough, else go to it with strides that end short of it."""
    if away_m <= _CLAIM_M:
        return reply.finished()
    return _go(thing, _depth_for(away_m))


def _depth_for(away_m: float) -> float:
    """Return the distance, or where it is small a depth whose stride ends about _STOP_M before the thing."""
    travel = away_m - _STOP_M
    if away_m >= _CAREFUL_M:
        return away_m if abs(away_m - search.WANDER_M) > 0.5 else search.WANDER_M - 1.0
    longest = NEAR_SCALE * STRIDE_MAX_M
    stride = travel if travel <= longest else 0.5 * travel
    return min(max(min(stride, longest) / NEAR_SCALE + 0.01, _SHORTEST_M), NEAR_M - 0.05)


def _go(thing: PlacedThing, depth_m: float) -> str:
    """Return a level `go` in a thing's direction."""
    side = thing.right_m / max(thing.depth_m, 0.5)
    return reply.go(500.0 + 500.0 * max(-0.99, min(0.99, side)), 500.0, depth_m)
