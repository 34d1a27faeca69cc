"""What a drone does about the board it was sent to: come near, read it, declare or stay."""

import math

from dronecats.pilots import reply
from dronecats.pilots.vision import boards, inscription, reading
from dronecats.pilots.vision.alike import LookAlike
from dronecats.pilots.vision.division import Spotted
from dronecats.pilots.vision.inscription import Inscription, ReadText
from dronecats.pilots.vision.paint import Picture
from dronecats.pilots.vision.ranging import CAMERA_AHEAD_M
from foundation.protocol import NEAR_M, NEAR_SCALE, STRIDE_MAX_M, STRIDE_MIN_M

_READ_M = 9.0  # within this, letters are large enough to be tried
_ARRIVED_M = 4.55  # from the body to the board's middle; the verifier's radius is 5 m
_ENDS_M = 3.3  # ahead of the camera: where the last stride is meant to end
_BELOW_M = 1.0  # of the eye: a board's middle, at the most
_LINE = (0.27, 0.73)  # of a board's height, where a single line stands
_STRETCH_MAX = 3.0


def decide(picture: Picture, board: LookAlike, wanted: Inscription) -> str:
    """Return the next action of a drone whose own board is in its picture."""
    known = inscription.agrees(wanted, read(picture, board)) if board.spot.ahead_m <= _READ_M else None
    if known is False:
        return reply.think()
    away = math.hypot(board.spot.ahead_m + CAMERA_AHEAD_M, board.spot.right_m, _BELOW_M)
    return reply.finished() if known and away <= _ARRIVED_M else towards(board.spot)


def towards(spot: Spotted) -> str:
    """Go to a spot with strides that end before it; far off, the depth is the distance and says so afterwards."""
    u = 500.0 + 500.0 * spot.right_m / spot.ahead_m
    travel = spot.ahead_m - _ENDS_M
    if travel >= STRIDE_MAX_M + STRIDE_MIN_M:
        return reply.go(u, 500.0, max(spot.ahead_m, NEAR_M))
    longest = NEAR_SCALE * STRIDE_MAX_M
    stride = travel if travel <= longest else 0.5 * travel
    return reply.go(u, 500.0, min(max(stride, STRIDE_MIN_M), longest) / NEAR_SCALE + 0.01)


def read(picture: Picture, board: LookAlike) -> list[ReadText]:
    """Return what stands on a board: the line across its middle, or whatever is found on it."""
    w, h = board.right - board.left, board.bottom - board.top
    stretch = min(max(boards.WIDTH_M / boards.HEIGHT_M * h / w, 1.0), _STRETCH_MAX)
    part = picture[max(0, board.top) : board.bottom, max(0, board.left) : board.right]
    line = reading.line(part[round(_LINE[0] * h) : round(_LINE[1] * h)], stretch)
    return line if any(r.confidence >= inscription.SURE for r in line) else reading.lines(part, stretch)
