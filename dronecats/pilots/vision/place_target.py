"""Chooses the action for a target that the command names by its place: "the bench left of the fountain".

The pilot searches each picture anew. The history has the drone's last action. After a `go` the target is straight
ahead, nearer by the length of the stride. The detector cannot find landmarks without a known shape, such as halls. If
the command names such a landmark, the drone visits things of the target's kind and declares at each thing.
"""

import itertools
import math
import zlib
from collections.abc import Iterable, Sequence

from dronecats.pilots import actions
from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import ranging, search, shape_detector
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.command import BEHIND, BETWEEN, LEFT, NEAREST, RIGHT, PlaceExpression
from dronecats.pilots.vision.shape_detector import PlacedThing
from foundation.protocol import FINISHED, GO, NEAR_M, NEAR_SCALE, ROTATE, STRIDE_MAX_M

FloorPoint = tuple[float, float]  # m, (right, ahead) in the ground plane, from the camera

BESIDE_M = 12.0  # `left of`, `right of`, `in front of` and `behind` hold fully up to this distance from the landmark
NEAREST_M = 25.0  # `nearest to` holds fully up to this distance from the landmark
_ARRIVED_M = 4.6  # the drone declares within this horizontal distance; success needs 5 m in three dimensions
_STOP_M = 4.1  # intended distance from the target at the end of the last stride
_CLOSER_M = 2.2  # distance to the thing's edge above which the drone comes closer before it declares again
_CAREFUL_M = 9.0  # within this distance strides are short
_SURE, _LIKELY = 0.3, -0.9  # log odds from which a thing is chosen, and from which a chosen thing is kept
_FOLLOWS_DEG, _FOLLOWS_M = 8.0, 1.8  # a chosen thing is at most this far off the nose (the larger limit counts)
_FOLLOWS_LOG = 0.45  # after a stride, largest |log(detected / expected distance)| of the chosen thing
_MARK_BONUS = 0.7  # added to the log odds of a landmark, which may be less certain than the target
_WEIGHT = 7.0  # log odds that a fulfilled relation adds
_VISITED_M = 6.5  # after the first step, a thing nearer than this counts as visited
_LEAVE_DEG = 75.0  # turn away from a wrong target
_ASIDE_DEG = 44.0  # angle off the direct way, to pass an obstacle
_BLOCKED_AFTER = 3  # after this many strides without progress, the drone flies round an obstacle
_KINDS_FOR = {"fountain": ("fountain", "tiered-fountain")}  # words that may mean several kinds


def decide(picture: Picture, expression: PlaceExpression, past: tuple[PastAction, ...]) -> str:
    """Return the action for one picture, for the target's expression and the drone's history."""
    kinds = _kinds_for(expression.kind)
    landmark_kinds = _kinds_for(*expression.landmarks)
    detections = shape_detector.find(picture, sorted(kinds | landmark_kinds), shape_detector.ShapeNetwork.shipped())
    wanted = [t for t in detections if t.kind in kinds]
    if past and past[-1].kind == FINISHED:
        return _after_declaration(picture, wanted, past)
    if past and past[-1].kind == GO and not search.count_wander_strides(past):
        return _follow(picture, wanted, past, expression, detections)
    return _choose(picture, wanted, past, expression, detections)


def _kinds_for(*words: str | None) -> set[str]:
    return {kind for word in words if word for kind in _KINDS_FOR.get(word, (word,))}


def _away_m(detection: PlacedThing) -> float:
    """Return the horizontal distance (m) of a thing from the body."""
    return math.hypot(detection.depth_m + ranging.CAMERA_AHEAD_M, detection.right_m)


def _after_declaration(picture: Picture, wanted: list[PlacedThing], past: tuple[PastAction, ...]) -> str:
    """Return the action after a declaration: come closer once and declare again, then turn away.

    The drone also comes closer without a detection: the detector may miss a near thing that fills the picture.
    """
    again = len(past) > 1 and past[-2].is_shortest_stride
    here = [t for t in wanted if _away_m(t) < _VISITED_M and abs(t.right_m) < _FOLLOWS_M]
    if not again and not here:
        return actions.go(500.0, 500.0, actions.SHORTEST_DEPTH_M)
    if not again:
        nearest = min(here, key=_away_m)
        if _away_m(nearest) - shape_detector.half_width_m(nearest.kind) > _CLOSER_M:
            return _go(nearest, actions.SHORTEST_DEPTH_M)
    return actions.rotate(math.copysign(_LEAVE_DEG, _picture_number(picture) % 2 - 0.5))


def _picture_number(picture: Picture) -> int:
    """Return a pseudo-random number that depends only on the picture, so that choices vary from step to step."""
    return zlib.crc32(picture[::4, ::4].tobytes())


def _follow(
    picture: Picture,
    wanted: list[PlacedThing],
    past: tuple[PastAction, ...],
    expression: PlaceExpression,
    detections: list[PlacedThing],
) -> str:
    """Return the next action towards the thing that the last stride aimed at.

    Without a detection, the drone declares if it should have arrived. It flies on if the thing should be near, or if
    the first picture showed the target. Otherwise it chooses a thing anew.
    """
    last = past[-1]
    stride = STRIDE_MAX_M if last.depth_m >= NEAR_M else NEAR_SCALE * last.depth_m
    expected = max(last.depth_m - stride, 3.0) if last.depth_m >= NEAR_M else _ARRIVED_M
    if len(past) > 1 and past[-2].kind == FINISHED and last.is_shortest_stride:
        return actions.finished()
    reach = max(math.radians(_FOLLOWS_DEG), math.atan(_FOLLOWS_M / expected))
    is_there = not expression.needs_search  # the first picture showed the target
    near = [
        t
        for t in wanted
        if (is_there or t.odds >= _LIKELY)
        and abs(math.atan2(t.right_m, t.depth_m)) < reach
        and abs(math.log(t.depth_m / expected)) < _FOLLOWS_LOG
    ]
    if near:
        best = max(near, key=lambda t: t.odds - 3.0 * abs(math.log(t.depth_m / expected)))
        away = 0.6 * _away_m(best) + 0.4 * (expected + ranging.CAMERA_AHEAD_M)
        return _stride_round(picture) if _blocked(past, away) else _approach(best, away)
    if expected <= _ARRIVED_M:
        return actions.finished()
    if expected <= _CAREFUL_M or is_there:  # the detector often misses far things: go straight on
        return _go(PlacedThing(expression.kind, expected, 0.0, 0.0, 0.0), _depth_for(expected + ranging.CAMERA_AHEAD_M))
    return _choose(picture, wanted, past, expression, detections)


def _blocked(past: tuple[PastAction, ...], away_m: float) -> bool:
    """Return whether the last strides made no progress to a thing that is now `away_m` away."""
    strides = past[-_BLOCKED_AFTER:]
    if len(strides) < _BLOCKED_AFTER or any(p.kind != GO or p.depth_m < NEAR_M for p in strides):
        return False
    return away_m > strides[0].depth_m - 0.5 * _BLOCKED_AFTER * STRIDE_MAX_M


def _stride_round(picture: Picture) -> str:
    """Return a stride past an obstacle, on the side where the view is more open."""
    u, _ = search.open_direction(picture)
    side = math.copysign(math.tan(math.radians(_ASIDE_DEG)), u - 500.0)
    return actions.go(500.0 + 500.0 * max(-0.99, min(0.99, side)), 500.0, search.WANDER_M)


def _choose(
    picture: Picture,
    wanted: list[PlacedThing],
    past: tuple[PastAction, ...],
    expression: PlaceExpression,
    detections: list[PlacedThing],
) -> str:
    """Return a `go` to the most likely target; without a likely target, a search action."""
    # no episode starts within _VISITED_M of its target, so the drone has already visited nearer things
    open_to = [t for t in wanted if not (past and _away_m(t) < _VISITED_M)]
    turns = search.count_trailing(past, ROTATE)
    ranked = sorted(((_log_odds(t, expression, detections), t) for t in open_to), key=lambda pair: -pair[0])
    # If the command says to search, the first picture does not show the target. During the first full turn the
    # drone accepts only a thing for which the relation to the landmark holds.
    has_known_landmarks = all(expression.landmarks)
    first_circle = expression.needs_search and turns == len(past) and turns < search.CIRCLE_TURNS
    least = _SURE + 0.3 * _WEIGHT if first_circle and has_known_landmarks else _SURE
    if not past and not expression.needs_search:  # the first picture shows the target, so accept any detection
        least = shape_detector.LEAST_ODDS
    if ranked and ranked[0][0] >= least and not (expression.needs_search and not past):
        likely = [t for odds, t in ranked if odds >= least]
        tours = expression.needs_search and not has_known_landmarks
        best = likely[_picture_number(picture) % len(likely)] if tours else ranked[0][1]
        return _approach(best, _away_m(best))
    landmark_kinds = _kinds_for(*expression.landmarks)
    far = [t for t in detections if t.kind in landmark_kinds and t.odds >= _SURE and _away_m(t) > 2.0 * _VISITED_M]
    if turns and far and not wanted:
        best = max(far, key=lambda t: t.odds)
        return _go(best, search.WANDER_M)
    return search.next_action(picture, past)


def _log_odds(detection: PlacedThing, expression: PlaceExpression, detections: Iterable[PlacedThing]) -> float:
    landmarks = [
        [t for t in detections if t.kind in _kinds_for(mark) and t is not detection] for mark in expression.landmarks
    ]
    if not all(landmarks):
        return detection.odds
    rivals = [
        _floor_point(t)
        for t in detections
        if t.kind in _kinds_for(expression.kind) and t is not detection and t.odds >= _SURE
    ]
    best = 0.0
    for pair in itertools.product(*landmarks):  # one landmark; two for BETWEEN
        sure = min(1.0 / (1.0 + math.exp(-t.odds - _MARK_BONUS)) for t in pair)
        holds = relation_fit(expression.relation, _floor_point(detection), [_floor_point(t) for t in pair], rivals)
        best = max(best, sure * holds)
    return min(detection.odds, 6.0) + _WEIGHT * best


def _floor_point(detection: PlacedThing) -> FloorPoint:
    return detection.right_m, detection.depth_m


def _approach(detection: PlacedThing, away_m: float) -> str:
    """Return a declaration at a thing that is near enough, else a stride that ends before the thing."""
    if away_m <= _ARRIVED_M:
        return actions.finished()
    return _go(detection, _depth_for(away_m))


def _depth_for(away_m: float) -> float:
    """Return the depth of a `go` to a thing; the last stride ends about _STOP_M before the thing."""
    if away_m >= _CAREFUL_M:
        return search.avoid_wander_depth(away_m)
    return actions.depth_of_stride(actions.short_stride_m(away_m - _STOP_M))


def _go(detection: PlacedThing, depth_m: float) -> str:
    """Return a level `go` in a thing's direction."""
    side = detection.right_m / max(detection.depth_m, 0.5)
    return actions.go(500.0 + 500.0 * max(-0.99, min(0.99, side)), 500.0, depth_m)


def relation_fit(
    relation: str, spot: FloorPoint, landmarks: Sequence[FloorPoint], rivals: Sequence[FloorPoint] = ()
) -> float:
    """Return how well a relation holds between `spot` and the landmarks, seen from (0, 0): 0 … 1.

    rivals: the other things of the target's kind. NEAREST compares `spot` with them.
    """
    if relation == NEAREST:
        return _nearest_fit(spot, landmarks[0], rivals)
    if relation == BETWEEN:
        return _between_fit(spot, landmarks[0], landmarks[1])
    beyond, right = _offset_from(spot, landmarks[0])
    away = math.hypot(beyond, right)
    near = _ramp(away, BESIDE_M + 8.0, BESIDE_M)
    if relation in (LEFT, RIGHT):
        side = right if relation == RIGHT else -right
        return near * _ramp(side, 0.0, 1.0) * _ramp(abs(beyond), 2.4 * max(side, 0.4), 1.1 * max(side, 0.4))
    way = beyond if relation == BEHIND else -beyond
    return near * _ramp(way, 0.0, 1.2) * _ramp(abs(right), 1.5 * max(way, 0.5), 0.5 * max(way, 0.5))


def _nearest_fit(spot: FloorPoint, landmark: FloorPoint, rivals: Sequence[FloorPoint]) -> float:
    away = math.dist(spot, landmark)
    least = min((math.dist(rival, landmark) for rival in rivals), default=math.inf)
    return _ramp(away, 1.4 * NEAREST_M, NEAREST_M) * _ramp(away, 1.6 * least + 1.0, least)


def _between_fit(spot: FloorPoint, a: FloorPoint, b: FloorPoint) -> float:
    span = max(math.dist(a, b), 1e-6)
    along = ((spot[0] - a[0]) * (b[0] - a[0]) + (spot[1] - a[1]) * (b[1] - a[1])) / span**2
    aside = abs((spot[0] - a[0]) * (b[1] - a[1]) - (spot[1] - a[1]) * (b[0] - a[0])) / span
    wide = max(1.5, 0.2 * span)
    return _ramp(abs(along - 0.5), 0.6, 0.4) * _ramp(aside, 2.0 * wide, wide)


def _offset_from(spot: FloorPoint, landmark: FloorPoint) -> tuple[float, float]:
    """Return the distances (m) of a spot beyond a landmark and to the right of it, seen from (0, 0)."""
    way = math.hypot(*landmark) or 1.0
    ahead = (landmark[0] / way, landmark[1] / way)
    off = (spot[0] - landmark[0], spot[1] - landmark[1])
    return off[0] * ahead[0] + off[1] * ahead[1], off[0] * ahead[1] - off[1] * ahead[0]


def _ramp(value: float, none: float, full: float) -> float:
    """Return 0 at `none` and beyond, 1 at `full` and beyond, and a linear value between."""
    if none == full:
        return float(value >= full)
    return min(max((value - none) / (full - none), 0.0), 1.0)
