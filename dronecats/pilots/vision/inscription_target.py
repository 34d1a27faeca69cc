"""Chooses the actions for a target that the command names by an inscription. Several things look like the target.

One request has the pictures of all drones. Each drone flies to a different thing, its *own thing*, and reads it. The
drone declares (`finished`) if its thing has the wanted inscription; otherwise it hovers (`think`). The pilot has no
memory. It recognises a drone's own thing by the drone's last action: after a `go`, the thing is straight ahead, and
the distance left is the depth of the `go` minus the stride.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from dronecats.pilots import actions
from dronecats.pilots.actions import LEVEL_PX, PastAction
from dronecats.pilots.vision import boards, color_detector, colors, ocr, plates
from dronecats.pilots.vision.colors import Picture
from dronecats.pilots.vision.command import Inscription, Referent, Size, read_place_in_row, read_referent
from dronecats.pilots.vision.division import Candidate, GroundPoint, assign_things
from foundation.protocol import GO, HISTORY_LENGTH, NEAR_M, ROTATE, STRIDE_MAX_M, THINK

Past = tuple[PastAction, ...]

# Tolerances that identify a drone's own thing: bearing of a far and of a near thing, log(distance / expected distance)
_ASIDE_RAD, _NEAR_ASIDE_RAD, _DISTANCE_LOG = math.radians(4.0), math.radians(8.0), 0.3
_DETOUR_FACTOR = 3.0  # factor on the tolerance of the bearing if the path leads round a vehicle
_MISMATCH_MAX = 3.0  # a drone's own thing is at most this multiple of the tolerances away from its expected place
_NEAR_THING_M = 16.0  # a thing that is expected beyond this distance is far
_BACK_DEG = 50.0  # turn to look for a lost thing
_THINKS_MAX = 2  # `think` actions after reading a plate; then the drone turns, to find vehicles not yet in a picture
_OTHER_M = 7.0  # a drone that looks for another thing skips things nearer than this, because it has read them
_LOST_M = 16.0  # a drone that turns to its lost thing accepts only things nearer than this
_SHORT_OF_M = 6.0  # after a short stride, a drone's own thing should be within this distance
_WANDER_M = 8.0  # depth of a stride to another place
_NEXT_THING_TURN_DEG = 60.0  # turn to look for the next thing after reading one
DULL = ("brown",)  # tried only if no other paint fits: bricks and tree trunks have this colour too
VIVID = tuple(color for color, band in colors.BANDS.items() if band.vivid and color not in DULL)
_LOOK_ALIKES = 4  # usual number of things that look alike; of a picture with more, only this many count
_ENOUGH_SCORE = 0.75  # if a paint reaches this total score per picture, DULL paints are not tried


def decide(pictures: Sequence[Picture], wanted: Inscription, command: str, past: Sequence[Past]) -> list[str]:
    """Return the next action of every drone, in picture order. Raises UsageError if no OCR package is installed."""
    ocr.load_engine()
    kind = read_referent(command.replace(" drone ", " "))
    under_way = any(past)
    views = find_candidates(pictures, wanted, kind, past if under_way else ())
    if not under_way and len(pictures) == 1:
        return [_depart(first_destination(views[0], read_place_in_row(command)))]
    if not under_way:
        return [_depart(spot) for spot in assign_things([[candidate.spot for candidate in view] for view in views])]
    all_settled = all(map(is_settled, past))
    return [
        actions.rotate(_NEXT_THING_TURN_DEG) if all_settled else _decide_one(picture, view, wanted, history, kind.size)
        for picture, view, history in zip(pictures, views, past, strict=True)
    ]


def first_destination(view: Sequence[Candidate], which: int | None) -> GroundPoint | None:
    """Return the first goal of a single drone: the thing with the index `which` from the left, else the nearest."""
    if not view:
        return None
    if which is not None and -len(view) <= which < len(view):
        return view[which].spot
    return min((candidate.spot for candidate in view), key=lambda spot: spot.distance_m)


def is_settled(past: Past, rests: int = HISTORY_LENGTH) -> bool:
    """Return whether the last `rests` actions are all `think` (the drone has read its thing) or all turns."""
    kinds = {action.kind for action in past[-rests:]}
    return len(past) >= rests and kinds in ({THINK}, {ROTATE})


def is_moving_on(past: Past) -> bool:
    """Return whether a drone has read its thing and looks for another thing."""
    return bool(past) and past[-1].kind == ROTATE and abs(past[-1].angle_deg - _NEXT_THING_TURN_DEG) < 0.5


def _depart(spot: GroundPoint | None) -> str:
    if spot is None or spot.ahead_m <= 0.0:
        return actions.rotate(_NEXT_THING_TURN_DEG)
    return actions.go(500.0 + 500.0 * spot.right_m / spot.ahead_m, 500.0, max(spot.ahead_m, NEAR_M))


def _decide_one(picture: Picture, view: Sequence[Candidate], wanted: Inscription, past: Past, size: Size) -> str:
    if past and past[-1].kind == THINK:
        return (
            actions.rotate(_NEXT_THING_TURN_DEG)
            if wanted.on_plate and is_settled(past, _THINKS_MAX)
            else actions.think()
        )
    own = own_candidate(view, past)
    if own is None and is_moving_on(past):
        has_circled = len(past) >= HISTORY_LENGTH and all(is_moving_on((action,)) for action in past)
        return actions.go(500.0, 500.0, _WANDER_M) if has_circled else actions.rotate(_NEXT_THING_TURN_DEG)
    if own is None:
        if past and past[-1].kind == GO and past[-1].depth_m >= NEAR_M + STRIDE_MAX_M and past[-1].y_px == LEVEL_PX:
            return actions.go(500.0, 500.0, past[-1].depth_m - STRIDE_MAX_M)  # the thing is hidden or too far away
        return plates.decide_unseen(past) if wanted.on_plate and past else actions.rotate(_BACK_DEG)
    if wanted.on_plate:
        return plates.decide(picture, own, wanted, past, size)
    return boards.decide(picture, own, wanted)


def own_candidate(view: Sequence[Candidate], past: Past) -> Candidate | None:
    """Return the thing that a drone flies to, identified by its last action; None if the picture does not show it."""
    if not view:
        return None
    if not past or past[-1].kind != GO:
        least, most = (_OTHER_M, math.inf) if is_moving_on(past) else (0.0, _LOST_M)
        if is_settled(past):
            most = math.inf
        near = [candidate for candidate in view if least < candidate.spot.distance_m < most]
        return min(near, key=lambda candidate: candidate.spot.distance_m) if near else None
    near_aside = _NEAR_ASIDE_RAD if past[-1].y_px == LEVEL_PX else _DETOUR_FACTOR * _NEAR_ASIDE_RAD
    left = past[-1].depth_m - STRIDE_MAX_M
    was_short = left <= NEAR_M  # the depth of a short stride sets its length, and does not give the thing's distance

    def mismatch(candidate: Candidate) -> float:
        aside = abs(candidate.spot.bearing_rad) / (_ASIDE_RAD if left > _NEAR_THING_M else near_aside)
        if was_short:
            return math.hypot(aside, max(0.0, math.log(max(candidate.spot.ahead_m, 0.1) / _SHORT_OF_M)) / _DISTANCE_LOG)
        off = math.log(max(candidate.spot.ahead_m, 0.1) / left) / _DISTANCE_LOG
        return math.hypot(aside, off)

    best = min(view, key=mismatch)
    return best if mismatch(best) <= _MISMATCH_MAX else None


def find_candidates(
    pictures: Sequence[Picture], wanted: Inscription, kind: Referent, past: Sequence[Past] = ()
) -> list[list[Candidate]]:
    """Return for each picture the things that may carry the inscription, left to right.

    All candidates of an episode have the same paint: for vehicles, the paint with the highest scores of the drones' own
    vehicles, or, if these are equal, of all vehicles. kind: the vehicle that the command names; not used for boards.
    """
    if not wanted.on_plate:
        return boards.find_alike(pictures, _LOOK_ALIKES)
    best: list[list[Candidate]] = [[] for _ in pictures]
    most = (0.0, 0.0)
    for color in (*VIVID, *DULL):
        if color in DULL and most[1] >= len(pictures) * _ENOUGH_SCORE:
            continue
        referent = replace(kind, color=color)
        views = [[_vehicle_candidate(d, p) for d in color_detector.find_all(p, referent)] for p in pictures]
        own_things = [own_candidate(view, history) for view, history in zip(views, past, strict=False)]
        rank = (
            sum(c.score * c.size_px for c in own_things if c),  # × size: a near vehicle is larger than a brick
            sum(sum(sorted((c.score for c in view), reverse=True)[:_LOOK_ALIKES]) for view in views),
        )
        if rank > most:
            most, best = rank, views
    return best


def _vehicle_candidate(detection: color_detector.Detection, picture: Picture) -> Candidate:
    height, width = picture.shape[:2]
    left, right = (round((x + 0.5) * width) for x in (detection.box.left, detection.box.right))
    top, bottom = (round(y * width + 0.5 * height) for y in (detection.box.top, detection.box.bottom))
    # the middle, (left + right) / 2, divided by the focal length of 1/2
    aside = (detection.box.left + detection.box.right) * detection.range.depth_m
    return Candidate(left, top, right, bottom, GroundPoint(aside, detection.range.depth_m), detection.score)
