"""Decides for a target that the command names by its colour and kind: "the cyan SUV"."""

import math

from dronecats.pilots import actions
from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import approach, color_detector, colors, ranging, search
from dronecats.pilots.vision.color_detector import Detection, ExpectedPlace
from dronecats.pilots.vision.command import Referent, Size
from foundation.protocol import FINISHED, GO, NEAR_M, RADIUS_M, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M

# Arriving. The verifier's radius is 5 m around the target's centre; the margin is for the error of the estimate.
ARRIVED_M = 4.6
_STOP_M = 3.8  # distance at which a stride shall end; after it the drone drifts on for about half a metre
_CAREFUL_M = 9.0  # within this, only short strides: the estimate may be off, and the target may come closer
_FILLS = 0.6  # of the picture's width: a thing this wide fills the picture
_EDGE = 0.015  # of the picture's width: this near the edge, the edge cuts a thing off
_AHEAD_M = 6.0  # a target that must be farther than this and is not detected: one more stride to its place
_LOST_M = 12.0  # a target does not get farther than this between two pictures
_SURE = 0.6  # score that a detection needs in the first circle

# Height. The agent ignores slopes under 0.15; near the target, gentle slopes are reduced below that.
_LEVEL, _LEVEL_BELOW = 0.14, 0.30
_LEVEL_WITHIN_M = 7.0


def decide(picture: colors.Picture, referent: Referent, past: tuple[PastAction, ...]) -> str:
    """Return the action for one picture, for the command's referent and the drone's history."""
    expected = _expected(past)
    detection = color_detector.find(picture, referent, expected)
    aspect = picture.shape[0] / picture.shape[1]
    if past and past[-1].kind == FINISHED:
        return _after_declaration(detection, aspect, referent.size, past)
    if detection is not None and search.is_rejected(detection, past):
        detection = None
    if detection is None:
        return _without_detection(picture, expected, past)
    if past and search.count_trailing(past, ROTATE) == len(past) and detection.score < _SURE:
        return search.next_action(picture, past)
    is_at_middle = referent.size.length_m < approach.LONG_M or approach.is_at_flank(detection, past)
    if detection.range.distance_m <= ARRIVED_M or (_fills(detection.box, aspect) and is_at_middle):
        return actions.finished()
    if approach.shows_long_end(detection, referent.size):
        return approach.stride_past_end(detection, past)
    return _approach(detection, aspect, past)


def _expected(past: tuple[PastAction, ...]) -> ExpectedPlace | None:
    """Return where the target of the last action must be: after a short stride or a declaration, straight ahead."""
    if approach.has_turned_to_flank(past):
        return ExpectedPlace(0.0, approach.FLANK_DISTANCE_M)
    if not past or past[-1].kind not in (GO, FINISHED) or search.count_wander_strides(past):
        return None
    if past[-1].kind == GO and (past[-1].x_px, past[-1].y_px) == approach.UNSEEN_PX:
        return ExpectedPlace(0.0, max(2.0, past[-1].depth_m - STRIDE_MAX_M))
    return approach.expected_place(past) or ExpectedPlace(0.0, _STOP_M)


def _without_detection(picture: colors.Picture, expected: ExpectedPlace | None, past: tuple[PastAction, ...]) -> str:
    """Return the action without a detection: one stride to where the target must be, then a search."""
    if _was_last_stride(past):
        return actions.finished()
    if search.has_turned_away(past):
        return search.stride_away(picture)
    turn = approach.turn_to_flank(past)
    if turn:
        return turn
    if expected is not None and expected.depth_m > _AHEAD_M and (past[-1].x_px, past[-1].y_px) != approach.UNSEEN_PX:
        return actions.go(500.0, 500.0, min(expected.depth_m, search.WANDER_M - 1.0))
    return search.next_action(picture, past)


def _after_declaration(detection: Detection | None, aspect: float, size: Size, past: tuple[PastAction, ...]) -> str:
    """Return the action after a declaration that did not end the flight: come nearer, then turn away.

    The target is farther away than it looks, or the detection is not the target.
    """
    if detection is None or detection.range.distance_m > _LOST_M or search.has_declared_enough(past):
        return search.turn_away(past)
    if size.length_m >= approach.LONG_M:
        along = approach.stride_along_flank(detection, past)
        if along:
            return along
        if approach.shows_long_end(detection, size):
            return approach.stride_past_end(detection, past)
    if detection.range.distance_m > ARRIVED_M:
        return _approach(detection, aspect, past)
    near_end_m = ranging.half_depth_m(detection.box, detection.range, size)
    room = max(detection.range.distance_m, RADIUS_M) - near_end_m - search.CLEARANCE_M
    if room < 0.5 * STRIDE_MIN_M:
        return search.turn_away(past)
    return _toward(detection, aspect, actions.depth_of_stride(min(room, search.CLOSER_STRIDE_M)))


def _fills(box: ranging.BoundingBox, aspect: float) -> bool:
    """Return whether the thing is wide and the lower edge cuts it off: its size says little then, but it is near.

    Even a car of 4.7 m, from the side, is within 4 m if it is wider than 0.6 of a 90° picture.
    """
    return box.bottom >= 0.5 * aspect - _EDGE and box.right - box.left >= _FILLS


def _was_last_stride(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was the shortest stride, which ends at the target.

    A target that is not detected after it is so near that its glass and its shadow fill the picture.
    """
    return bool(past) and past[-1].kind == GO and past[-1].depth_m <= actions.SHORTEST_DEPTH_M + 0.1


def _approach(detection: Detection, aspect: float, past: tuple[PastAction, ...]) -> str:
    """Go to the detection, or ahead of it if it moves across, with strides that end short of it."""
    if detection.range.distance_m < _CAREFUL_M:
        return _toward(detection, aspect, _depth_for(detection.range))
    aside = approach.compute_lead(detection, past)
    return _toward(detection, aspect, approach.encode_lead(_depth_for(detection.range), aside), aside)


def _toward(detection: Detection, aspect: float, depth_m: float, aside: float = 0.0) -> str:
    x = 0.5 * (detection.box.left + detection.box.right) + aside
    y = 0.5 * (detection.box.top + detection.box.bottom)
    slope = y / math.hypot(ranging.FOCAL_PER_WIDTH, x)
    if detection.range.distance_m < _LEVEL_WITHIN_M and abs(slope) < _LEVEL_BELOW:
        y *= min(1.0, _LEVEL / max(abs(slope), 1e-6))
    return actions.go(500.0 + 1000.0 * x, 500.0 + 1000.0 * y / aspect, depth_m)


def _depth_for(estimate: ranging.Range) -> float:
    """Return the estimated depth; near the target, a depth whose stride ends about _STOP_M before it."""
    if estimate.distance_m >= _CAREFUL_M:
        return search.avoid_wander_depth(max(estimate.depth_m, NEAR_M))
    return actions.depth_of_stride(actions.short_stride_m(estimate.distance_m - _STOP_M))
