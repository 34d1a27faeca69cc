"""A pilot of classical vision: it sees the JPEG, reads the prompt, knows ordinary sizes and colours, and nothing else.

Assumed knowledge beyond the picture: a level pinhole camera, 90° across (paper, appendix "Execution"), usual sizes of
things, and the rules by which a `go` is flown. No truth, no map, no memory: what it did before it reads in the prompt's
history, so equal requests get equal answers. What is told by colour it looks for by colour and size; what is told by
where it stands, by shape and place (`seeking`). Of several drones it makes a fleet that reads signs and plates
(`fleet`). It reads no names on halls.
"""

import math

import cv2
import numpy as np

from dronecats.pilots import briefing, reply
from dronecats.pilots.briefing import PastAction
from dronecats.pilots.vision import (
    expression,
    flank,
    fleet,
    inscription,
    lead,
    paint,
    ranging,
    referent,
    refused,
    search,
    seeking,
    sighting,
)
from foundation.errors import UsageError
from foundation.protocol import FINISHED, GO, NEAR_M, NEAR_SCALE, RADIUS_M, ROTATE, STRIDE_MAX_M, STRIDE_MIN_M

_WIDTH = 640  # px, what the agent sends and what the thresholds in pixels are made for

# Arriving. The verifier's radius is 5 m around the target's centre; the margin is for the error of the estimate.
ARRIVED_M = 4.6
_TARGET_M = 3.8  # where strides are meant to end; a body in flight runs on for about half a metre after one
_CAREFUL_M = 9.0  # within this, only short strides: the estimate may be off, and a target may come towards the drone
_FILLS = 0.6  # of the picture's width
_EDGE = 0.015  # of the picture's width: so near the edge a thing is cut off by it
_AHEAD_M = 6.0  # what must be farther off than this and is not seen is gone on to once
_LOST_M = 12.0  # what is claimed does not get so far away between two pictures
_SURE = 0.6  # how good a sighting has to be in the first circle: what is to be looked for stands in plain view there

# How a `go` is flown
_SHORTEST_DEPTH_M = STRIDE_MIN_M / NEAR_SCALE + 0.01
_LEVEL, _LEVEL_BELOW = 0.14, 0.30  # slopes under 0.15 keep the height; near the target, gentle ones are made such
_LEVEL_WITHIN_M = 7.0


def answer(prompt: str, images: list[bytes]) -> str:
    """Return the next action of every picture's drone. Raises UsageError when there is no picture or it is broken."""
    if not images:
        raise UsageError("The vision pilot needs a picture.")
    told = briefing.read(prompt)
    written = inscription.named(told.command)
    if written is not None:
        pictures = [decode(jpeg) for jpeg in images]
        return reply.fleet(fleet.answer(pictures, written, told.command, [told.past(k) for k in range(len(images))]))
    named = referent.read(told.command)
    placed = expression.read(told.command) if named.color is None else None
    if placed is not None:
        return reply.fleet([seeking.decide(decode(jpeg), placed, told.past(k)) for k, jpeg in enumerate(images)])
    return reply.fleet([decide(decode(jpeg), named, told.past(k)) for k, jpeg in enumerate(images)])


def decode(jpeg: bytes) -> paint.Picture:
    """Return the picture (H, W, 3) in BGR, at most 640 px wide. Raises UsageError when it cannot be read."""
    data = np.frombuffer(jpeg, np.uint8)
    picture = None
    if len(data):
        try:
            picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
        except cv2.error:
            picture = None
    if picture is None or min(picture.shape[:2]) < 16:
        raise UsageError("The picture cannot be decoded, or is smaller than 16 pixels.")
    height, width = picture.shape[:2]
    if width > _WIDTH:
        picture = cv2.resize(picture, (_WIDTH, max(16, round(height * _WIDTH / width))), interpolation=cv2.INTER_AREA)
    return np.asarray(picture, np.uint8)


def decide(picture: paint.Picture, named: referent.Referent, past: tuple[PastAction, ...]) -> str:
    """Return the action for one picture, given what is looked for and what was done before."""
    expected = _expected(past)
    seen = sighting.find(picture, named, expected)
    aspect = picture.shape[0] / picture.shape[1]
    if past and past[-1].kind == FINISHED:
        return _doubt(seen, aspect, named.size, past)
    if seen is not None and refused.is_it(seen, past):
        seen = None
    if seen is None:
        return _look(picture, expected, past)
    if past and search.trailing(past, ROTATE) == len(past) and seen.score < _SURE:
        return search.search(picture, past)
    before_it = named.size.length_m < flank.LONG_M or flank.is_before(seen, past)
    if seen.range.distance_m <= ARRIVED_M or (_fills(seen.box, aspect) and before_it):
        return reply.finished()
    return flank.beside(seen, past) if flank.is_way(seen, named.size) else _approach(seen, aspect, past)


def _expected(past: tuple[PastAction, ...]) -> sighting.Expected | None:
    """Return where what was gone for or claimed must be: after a short stride or a claim, before the drone."""
    if flank.turned(past):
        return sighting.Expected(0.0, flank.OFF_M)
    if not past or past[-1].kind not in (GO, FINISHED) or search.wanders(past):
        return None
    if past[-1].kind == GO and (past[-1].x_px, past[-1].y_px) == lead.BLIND_PX:
        return sighting.Expected(0.0, max(2.0, past[-1].depth_m - STRIDE_MAX_M))
    return lead.expected(past) or sighting.Expected(0.0, _TARGET_M)


def _look(picture: paint.Picture, expected: sighting.Expected | None, past: tuple[PastAction, ...]) -> str:
    """Return what follows where nothing is seen: once on to where it must be, then a search."""
    if _was_before_it(past):
        return reply.finished()
    if refused.leaving(past):
        return refused.away(picture)
    passed = flank.turn(past)
    if passed:
        return passed
    if expected is not None and expected.depth_m > _AHEAD_M and (past[-1].x_px, past[-1].y_px) != lead.BLIND_PX:
        return reply.go(500.0, 500.0, min(expected.depth_m, search.WANDER_M - 1.0))
    return search.search(picture, past)


def _doubt(seen: sighting.Sighting | None, aspect: float, size: referent.Size, past: tuple[PastAction, ...]) -> str:
    """Return what follows a claim: the flight would have ended with it, so it is farther off than it looks, or not it.

    So it comes nearer and claims again; and goes elsewhere when that has brought nothing either.
    """
    if seen is None or seen.range.distance_m > _LOST_M or refused.again(past):
        return refused.turn(past)
    if size.length_m >= flank.LONG_M:
        along = flank.along(seen, past)
        if along:
            return along
        if flank.is_way(seen, size):
            return flank.beside(seen, past)
    if seen.range.distance_m > ARRIVED_M:
        return _approach(seen, aspect, past)
    room = max(seen.range.distance_m, RADIUS_M) - ranging.half_depth_m(seen.box, seen.range, size) - refused.ROOM_M
    if room < 0.5 * STRIDE_MIN_M:
        return refused.turn(past)
    return _toward(seen, aspect, _depth_of(min(room, refused.NEARER_M)))


def _fills(box: ranging.BoundingBox, aspect: float) -> bool:
    """Return whether the thing is cut off by the lower edge and wide: then its size says little, but it is here.

    Even a car of 4.7 m that is seen from the side is within 4 m when it is wider than 0.6 of a 90° picture.
    """
    return box.bottom >= 0.5 * aspect - _EDGE and box.right - box.left >= _FILLS


def _was_before_it(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was the shortest stride: flown only to a thing some five metres ahead.

    What is lost from sight after it is not gone but so near that its glass and its shadow fill the picture.
    """
    return bool(past) and past[-1].kind == GO and past[-1].depth_m <= _SHORTEST_DEPTH_M + 0.1


def _approach(seen: sighting.Sighting, aspect: float, past: tuple[PastAction, ...]) -> str:
    """Go to the sighting, or ahead of it where it moves across, with strides that end short of it."""
    if seen.range.distance_m < _CAREFUL_M:
        return _toward(seen, aspect, _depth_for(seen.range))
    aside = lead.ahead(seen, past)
    return _toward(seen, aspect, lead.coded(_depth_for(seen.range), aside), aside)


def _depth_of(stride_m: float) -> float:
    """Return the depth for a stride of 1.2 m to almost 3 m."""
    return min(max(stride_m / NEAR_SCALE + 0.01, _SHORTEST_DEPTH_M), NEAR_M - 0.05)


def _toward(seen: sighting.Sighting, aspect: float, depth_m: float, aside: float = 0.0) -> str:
    x = 0.5 * (seen.box.left + seen.box.right) + aside
    y = 0.5 * (seen.box.top + seen.box.bottom)
    slope = y / math.hypot(ranging.FOCAL_PER_WIDTH, x)
    if seen.range.distance_m < _LEVEL_WITHIN_M and abs(slope) < _LEVEL_BELOW:
        y *= min(1.0, _LEVEL / max(abs(slope), 1e-6))
    return reply.go(500.0 + 1000.0 * x, 500.0 + 1000.0 * y / aspect, depth_m)


def _depth_for(there: ranging.Range) -> float:
    """Return the estimated depth, changed where the stride it causes would not end near _TARGET_M."""
    travel = there.distance_m - _TARGET_M
    if there.distance_m >= _CAREFUL_M:
        depth = max(there.depth_m, NEAR_M)
        return depth if abs(depth - search.WANDER_M) > 0.5 else search.WANDER_M - 1.0
    longest = NEAR_SCALE * STRIDE_MAX_M
    # what two short strides can cover is halved, so that the last one is not too short to be flown
    stride = travel if travel <= longest else 0.5 * travel
    return _depth_of(min(stride, longest))
