"""Aiming ahead of what moves across the way.

How far ahead a stride was aimed is told by the last digit of its depth. So the next picture shows how far the thing
has gone across meanwhile, and where it will be when the drone is there.
"""

from dronecats.pilots.briefing import LEVEL_PX, PastAction
from dronecats.pilots.vision import search
from dronecats.pilots.vision.ranging import FOCAL_PER_WIDTH
from dronecats.pilots.vision.sighting import Expected, Sighting
from foundation.protocol import GO, NEAR_M, STRIDE_MAX_M

MIDDLE_PX = 640.0
BLIND_PX = (MIDDLE_PX, LEVEL_PX)  # the point of a stride to what was not seen
_FROM_M = NEAR_M + 1.0  # smaller depths tell other things
_STEP = 0.03  # of the picture's width, a digit
_NONE = 5  # the digit of no lead
_STILL_M = 0.4  # across in a stride: less is the drone's own wander
_MOST_M = 1.2  # across in a stride: paths are driven at 0.3 m/s, and a stride with its turn takes 4 s at most
_STRIDES = 2.0  # that are looked ahead, at most
_SHORT_OF_M = 4.0  # of the thing, where the last stride ends


def coded(depth_m: float, lead: float) -> float:
    """Return a depth of a long stride that tells a lead (fraction of the picture's width, + right)."""
    digit = min(9, max(0, round(lead / _STEP) + _NONE))
    return max(_FROM_M, int(depth_m * 10.0) / 10.0) + 0.01 * digit


def told(past: tuple[PastAction, ...]) -> float | None:
    """Return the lead of the last action; None where that was no long stride to what was seen."""
    if not past or past[-1].kind != GO or past[-1].depth_m < _FROM_M or search.wanders(past):
        return None
    if (past[-1].x_px, past[-1].y_px) == BLIND_PX:
        return None
    return (round(past[-1].depth_m * 100.0) % 10 - _NONE) * _STEP


def expected(past: tuple[PastAction, ...]) -> Expected | None:
    """Return where what the last long stride was for must be, did it stand still; None where there was none."""
    lead = told(past)
    if lead is None:
        return None
    left = max(2.0, past[-1].depth_m - STRIDE_MAX_M)
    return Expected(-lead * past[-1].depth_m / left, left)


def ahead(seen: Sighting, past: tuple[PastAction, ...]) -> float:
    """Return how far to the side of what is seen to aim, in fractions of the picture's width, + right."""
    before = told(past)
    if before is None:
        return 0.0
    x, depth = 0.5 * (seen.box.left + seen.box.right), seen.range.depth_m
    across = (x * depth + before * past[-1].depth_m) / FOCAL_PER_WIDTH
    if abs(across) < _STILL_M:
        return 0.0
    strides = min(_STRIDES, max(0.0, (depth - _SHORT_OF_M) / STRIDE_MAX_M))
    lead = min(_MOST_M, max(-_MOST_M, across)) * strides * FOCAL_PER_WIDTH / depth
    return _STEP * min(9 - _NONE, max(-_NONE, round(lead / _STEP)))
