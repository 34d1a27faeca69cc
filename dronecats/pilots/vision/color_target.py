"""Chooses the action for a target that the command names by its colour and kind: "the cyan SUV".

The drone aims ahead of moving targets, and flies round the end of long targets. Both tasks need a value from the
previous step. The pilot has no memory, but the prompt's history has the depths of its strides (`go` actions). So these
depths encode the values:

- The last digit of a long stride's depth encodes the lead: the offset by which the stride aimed beside the target. From
  the lead and the next picture, the pilot computes how far the target has moved sideways.
- The depths _RIGHT_M and _LEFT_M encode the side on which the drone passes a long target (a bus). A flight succeeds
  only near the target's middle. The ends are too far from it, so the drone must fly to a flank.
"""

import math

from dronecats.pilots import actions
from dronecats.pilots.actions import LEVEL_PX, PastAction
from dronecats.pilots.vision import color_detector, colors, ranging, search
from dronecats.pilots.vision.color_detector import Detection, ExpectedPlace
from dronecats.pilots.vision.command import Referent, Size
from dronecats.pilots.vision.ranging import FOCAL_PER_WIDTH
from foundation.protocol import FINISHED, GO, NEAR_M, RADIUS_M, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M

MIDDLE_PX = 640.0
UNSEEN_PX = (MIDDLE_PX, LEVEL_PX)  # the point of a stride to a target that was not detected
_LEAD_DEPTH_MIN_M = NEAR_M + 1.0  # smaller depths do not encode a lead
_LEAD_STEP = 0.03  # lead per unit of the digit, as a fraction of the picture's width
_NO_LEAD = 5  # the digit for no lead
_STILL_M = 0.4  # least sideways motion per stride for which a target counts as moving; less is the drone's own drift
_MOST_ACROSS_M = 1.2  # limit of the sideways motion during a stride: 0.3 m/s for 4 s, the time of a turn and a stride
_MOST_STRIDES = 2.0  # the lead covers the target's motion during at most this many strides
_SHORT_OF_M = 4.0  # distance from the target at which the last stride is assumed to end
LONG_M = 7.0  # a thing is long from this length on
_END_REACH_M = 3.2  # the drone passes the near end of a long thing if the end is at least this far from the middle
_LONG_WITHIN_M = 20.0  # at larger distances the drone flies straight to a long thing
_CLEAR_M = 1.9  # distance between the drone's path and the edge of the thing
_RIGHT_M, _LEFT_M = 5.1, 5.2  # depths of a 3 m stride past the thing's right or left side in the picture
_FLANK_TURN_DEG = 60.0
FLANK_DISTANCE_M = 4.0  # distance from a passing drone to the flank
_PASSING_OFFSET = 0.08  # fraction of the picture's width; a thing farther right is passed on its left, and vice versa
_CUT_OFF = 0.49  # fraction of the picture's width; the picture cuts off a thing that reaches farther from the middle


def encode_lead(depth_m: float, lead: float) -> float:
    """Return a depth (m) of a long stride that encodes a lead (fraction of the picture's width, + right)."""
    digit = min(9, max(0, round(lead / _LEAD_STEP) + _NO_LEAD))
    return max(_LEAD_DEPTH_MIN_M, int(depth_m * 10.0) / 10.0) + 0.01 * digit


def decode_lead(past: tuple[PastAction, ...]) -> float | None:
    """Return the lead of the last action; None if it was not a long stride to a detection."""
    if not past or past[-1].kind != GO or past[-1].depth_m < _LEAD_DEPTH_MIN_M or search.count_wander_strides(past):
        return None
    if (past[-1].x_px, past[-1].y_px) == UNSEEN_PX:
        return None
    return (round(past[-1].depth_m * 100.0) % 10 - _NO_LEAD) * _LEAD_STEP


def expected_place(past: tuple[PastAction, ...]) -> ExpectedPlace | None:
    """Return where a still target is expected after a long stride to it; None after any other action."""
    lead = decode_lead(past)
    if lead is None:
        return None
    left = max(2.0, past[-1].depth_m - STRIDE_MAX_M)
    return ExpectedPlace(-lead * past[-1].depth_m / left, left)


def compute_lead(detection: Detection, past: tuple[PastAction, ...]) -> float:
    """Return the lead for the next stride (fraction of the picture's width, + right)."""
    before = decode_lead(past)
    if before is None:
        return 0.0
    x, depth = 0.5 * (detection.box.left + detection.box.right), detection.range.depth_m
    across = (x * depth + before * past[-1].depth_m) / FOCAL_PER_WIDTH
    if abs(across) < _STILL_M:
        return 0.0
    strides = min(_MOST_STRIDES, max(0.0, (depth - _SHORT_OF_M) / STRIDE_MAX_M))
    lead = min(_MOST_ACROSS_M, max(-_MOST_ACROSS_M, across)) * strides * FOCAL_PER_WIDTH / depth
    return _LEAD_STEP * min(9 - _NO_LEAD, max(-_NO_LEAD, round(lead / _LEAD_STEP)))


def shows_long_end(detection: Detection, size: Size) -> bool:
    """Return whether the drone sees the end of a long thing."""
    if size.length_m < LONG_M or detection.range.distance_m > _LONG_WITHIN_M:
        return False
    return ranging.middle_to_near_end_m(detection.box, detection.range, size) >= _END_REACH_M


def is_at_flank(detection: Detection, past: tuple[PastAction, ...]) -> bool:
    """Return whether the drone is at the flank: it passes the thing, or the thing spans the picture."""
    return passing_side(past) != 0 or (detection.box.left < -_CUT_OFF and detection.box.right > _CUT_OFF)


def passing_side(past: tuple[PastAction, ...]) -> int:
    """Return 1 or -1 if the last stride passed a thing on the thing's right or left side; else 0."""
    last = next((p for p in reversed(past) if p.kind == GO), None)
    if last is None:
        return 0
    return (abs(last.depth_m - _RIGHT_M) < 0.02) - (abs(last.depth_m - _LEFT_M) < 0.02)


def stride_past_end(detection: Detection, past: tuple[PastAction, ...]) -> str:
    """Return a stride past the near end of a long thing. Without another reason, the side is the flank's.

    In the picture, the flank's upper edge drops with distance, so the sign of `Detection.lean` gives the flank's side.
    """
    box = detection.box
    middle = 0.5 * (box.left + box.right)
    flank = 1 if detection.lean > 0.0 else -1
    side = passing_side(past) or (-1 if middle > _PASSING_OFFSET else 1 if middle < -_PASSING_OFFSET else flank)
    outer = box.right if side > 0 else -box.left
    if outer > _CUT_OFF:  # the thing fills the picture on that side
        side, outer = -side, -box.left if side > 0 else box.right
    # `near`: depth of the near end, or of the far end if the near end is already beside the drone
    beside_it = (box.left < -_CUT_OFF) if side > 0 else (box.right > _CUT_OFF)
    near = max(2.0, detection.range.depth_m + (_END_REACH_M if beside_it else -_END_REACH_M))
    return _coded_stride(side * min(_CUT_OFF, outer + _CLEAR_M * FOCAL_PER_WIDTH / near), side)


def stride_along_flank(detection: Detection, past: tuple[PastAction, ...]) -> str | None:
    """Return a stride along the flank; None if its direction is unknown.

    It goes straight ahead; after a turn, it goes to the only side on which the picture cuts off the flank.
    """
    side = passing_side(past)
    if not side:
        return None
    if len(past) < 2 or past[-2].kind != ROTATE:
        return _coded_stride(0.0, side)
    left, right = detection.box.left < -_CUT_OFF, detection.box.right > _CUT_OFF
    if left == right:
        return None
    return _coded_stride(-_CUT_OFF if left else _CUT_OFF, side)


def turn_to_flank(past: tuple[PastAction, ...]) -> str | None:
    """Return a turn to the thing if the last action was a stride past it; else None."""
    side = passing_side(past)
    return actions.rotate(-_FLANK_TURN_DEG * side) if side and past[-1].kind == GO else None


def has_turned_to_flank(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was the turn of `turn_to_flank`. The flank is then straight ahead."""
    if len(past) < 2 or past[-1].kind != ROTATE or past[-2].kind != GO:
        return False
    return past[-1].angle_deg == -_FLANK_TURN_DEG * passing_side(past)


def _coded_stride(x: float, side: int) -> str:
    return actions.go(500.0 + 1000.0 * x, 500.0, _RIGHT_M if side > 0 else _LEFT_M)


# Arrival. A flight succeeds within 5 m of the target's centre; the margin is for the error of the estimate.
ARRIVED_M = 4.6
_STOP_M = 3.8  # distance from the target at which a stride ends; the drone then drifts on for about half a metre
_CAREFUL_M = 9.0  # within this distance strides are short: the estimate may be wrong, and the target may approach
_FILLS = 0.6  # fraction of the picture's width; a wider thing fills the picture
_EDGE = 0.015  # fraction of the picture's width; a thing this near to the edge counts as cut off
_AHEAD_M = 6.0  # if an undetected target is expected beyond this distance, the drone flies one more stride
_LOST_M = 12.0  # a detection farther away than this after a declaration is not the target
_FIRST_CIRCLE_SCORE_MIN = 0.6  # until the first stride, a detection after a turn needs at least this score

# Height. The controller flies level at slopes below 0.15. Near the target, _LEVEL limits slopes up to _LEVEL_BELOW
_LEVEL, _LEVEL_BELOW = 0.14, 0.30
_LEVEL_WITHIN_M = 7.0


def decide(picture: colors.Picture, referent: Referent, past: tuple[PastAction, ...]) -> str:
    """Return the action for one picture, given the command's referent and the drone's history."""
    expected = _expected(past)
    detection = color_detector.find(picture, referent, expected)
    aspect = picture.shape[0] / picture.shape[1]
    if past and past[-1].kind == FINISHED:
        return _after_declaration(detection, aspect, referent.size, past)
    if detection is not None and search.is_rejected(detection, past):
        detection = None
    if detection is None:
        return _without_detection(picture, expected, past)
    if past and search.count_trailing(past, ROTATE) == len(past) and detection.score < _FIRST_CIRCLE_SCORE_MIN:
        return search.next_action(picture, past)
    is_at_middle = referent.size.length_m < LONG_M or is_at_flank(detection, past)
    if detection.range.distance_m <= ARRIVED_M or (_fills(detection.box, aspect) and is_at_middle):
        return actions.finished()
    if shows_long_end(detection, referent.size):
        return stride_past_end(detection, past)
    return _approach(detection, aspect, past)


def _expected(past: tuple[PastAction, ...]) -> ExpectedPlace | None:
    """Return the expected place of the last action's target: straight ahead after a short stride or a declaration."""
    if has_turned_to_flank(past):
        return ExpectedPlace(0.0, FLANK_DISTANCE_M)
    if not past or past[-1].kind not in (GO, FINISHED) or search.count_wander_strides(past):
        return None
    if past[-1].kind == GO and (past[-1].x_px, past[-1].y_px) == UNSEEN_PX:
        return ExpectedPlace(0.0, max(2.0, past[-1].depth_m - STRIDE_MAX_M))
    return expected_place(past) or ExpectedPlace(0.0, _STOP_M)


def _without_detection(picture: colors.Picture, expected: ExpectedPlace | None, past: tuple[PastAction, ...]) -> str:
    """Return the action without a detection: a declaration after a shortest stride, else a stride, turn or search."""
    if past and past[-1].is_shortest_stride:  # so near that the glass and the shadow of the target fill the picture
        return actions.finished()
    if search.has_turned_away(past):
        return actions.go(search.open_direction(picture)[0], 500.0, search.WANDER_M)
    turn = turn_to_flank(past)
    if turn:
        return turn
    if expected is not None and expected.depth_m > _AHEAD_M and (past[-1].x_px, past[-1].y_px) != UNSEEN_PX:
        return actions.go(500.0, 500.0, min(expected.depth_m, search.WANDER_M - 1.0))
    return search.next_action(picture, past)


def _after_declaration(detection: Detection | None, aspect: float, size: Size, past: tuple[PastAction, ...]) -> str:
    """Return the action after a declaration that did not end the flight: come nearer, then turn away.

    The flight goes on because the target is farther away than estimated, or the detection is not the target.
    """
    declarations = sum(p.kind == FINISHED for p in past)
    if detection is None or detection.range.distance_m > _LOST_M or declarations >= search.MOST_DECLARATIONS:
        return search.turn_away(past)
    if size.length_m >= LONG_M:
        along = stride_along_flank(detection, past)
        if along:
            return along
        if shows_long_end(detection, size):
            return stride_past_end(detection, past)
    if detection.range.distance_m > ARRIVED_M:
        return _approach(detection, aspect, past)
    near_end_m = ranging.middle_to_near_end_m(detection.box, detection.range, size)
    room = max(detection.range.distance_m, RADIUS_M) - near_end_m - search.CLEARANCE_M
    if room < 0.5 * STRIDE_MIN_M:
        return search.turn_away(past)
    return _toward(detection, aspect, actions.depth_of_stride(min(room, search.CLOSER_STRIDE_M)))


def _fills(box: ranging.BoundingBox, aspect: float) -> bool:
    """Return whether a thing is wide and cut off by the lower edge. Such a thing is near; its size gives no distance.

    A car of 4.7 m, seen from the side, is within 4 m if it is wider than 0.6 of a 90° picture.
    """
    return box.bottom >= 0.5 * aspect - _EDGE and box.right - box.left >= _FILLS


def _approach(detection: Detection, aspect: float, past: tuple[PastAction, ...]) -> str:
    """Return a stride that ends before the detected target. It aims ahead of a target that moves sideways."""
    if detection.range.distance_m < _CAREFUL_M:
        return _toward(detection, aspect, _depth_for(detection.range))
    aside = compute_lead(detection, past)
    return _toward(detection, aspect, encode_lead(_depth_for(detection.range), aside), aside)


def _toward(detection: Detection, aspect: float, depth_m: float, aside: float = 0.0) -> str:
    x = 0.5 * (detection.box.left + detection.box.right) + aside
    y = 0.5 * (detection.box.top + detection.box.bottom)
    slope = y / math.hypot(ranging.FOCAL_PER_WIDTH, x)
    if detection.range.distance_m < _LEVEL_WITHIN_M and abs(slope) < _LEVEL_BELOW:
        y *= min(1.0, _LEVEL / max(abs(slope), 1e-6))
    return actions.go(500.0 + 1000.0 * x, 500.0 + 1000.0 * y / aspect, depth_m)


def _depth_for(estimate: ranging.Range) -> float:
    """Return the depth of a `go` to the target; the last stride ends about _STOP_M before the target."""
    if estimate.distance_m >= _CAREFUL_M:
        return search.avoid_wander_depth(max(estimate.depth_m, NEAR_M))
    return actions.depth_of_stride(actions.short_stride_m(estimate.distance_m - _STOP_M))
