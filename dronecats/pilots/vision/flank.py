"""Coming near the middle of what is long, as a bus: past its end and along its flank.

From before or behind, one gets no nearer to its middle than half its length, which is more than the radius of success.
On which side of it the drone passes, it reads in the depth of its last stride.
"""

from dronecats.pilots import reply
from dronecats.pilots.briefing import PastAction
from dronecats.pilots.vision import ranging
from dronecats.pilots.vision.ranging import FOCAL_PER_WIDTH
from dronecats.pilots.vision.referent import Size
from dronecats.pilots.vision.sighting import Sighting
from foundation.protocol import GO, ROTATE

LONG_M = 7.0
_REACHES_M = 3.2  # from its middle towards the drone, from which it is gone past
_WITHIN_M = 20.0
_CLEAR_M = 1.9  # between the way and its edge, as it is seen
_RIGHT_M, _LEFT_M = 5.1, 5.2  # depths of a stride of 3 m that say: the way goes to the right of it, or to the left
_TURN_DEG = 60.0
OFF_M = 4.0  # of its flank, from a drone that passes it
_ACROSS = 0.08  # of the picture's width, off its middle, from which the drone is already on its way past
_EDGE = 0.49  # of the width, likewise: there it is cut off


def is_way(seen: Sighting, size: Size) -> bool:
    """Return whether a sighting is of an end of something long."""
    if size.length_m < LONG_M or seen.range.distance_m > _WITHIN_M:
        return False
    return ranging.half_depth_m(seen.box, seen.range, size) >= _REACHES_M


def is_before(seen: Sighting, past: tuple[PastAction, ...]) -> bool:
    """Return whether a sighting that fills the picture is of a flank: from side to side, or beside the way past it."""
    return passing(past) != 0 or (seen.box.left < -_EDGE and seen.box.right > _EDGE)


def passing(past: tuple[PastAction, ...]) -> int:
    """Return 1 or -1 where the last stride went past something, to the right or to the left of it; else 0."""
    last = next((p for p in reversed(past) if p.kind == GO), None)
    if last is None:
        return 0
    return (abs(last.depth_m - _RIGHT_M) < 0.02) - (abs(last.depth_m - _LEFT_M) < 0.02)


def beside(seen: Sighting, past: tuple[PastAction, ...]) -> str:
    """Return a stride past the thing: on the side of its flank, which falls away from the end that is near."""
    box = seen.box
    middle = 0.5 * (box.left + box.right)
    side = passing(past) or (-1 if middle > _ACROSS else 1 if middle < -_ACROSS else 1 if seen.lean > 0.0 else -1)
    outer = box.right if side > 0 else -box.left
    if outer > _EDGE:  # it fills the picture on that side
        side, outer = -side, -box.left if side > 0 else box.right
    # the edge is that of its near end; or of its far one, where the near one is beside the drone already
    beside_it = (box.left < -_EDGE) if side > 0 else (box.right > _EDGE)
    near = max(2.0, seen.range.depth_m + (_REACHES_M if beside_it else -_REACHES_M))
    return _stride(side * min(_EDGE, outer + _CLEAR_M * FOCAL_PER_WIDTH / near), side)


def along(seen: Sighting, past: tuple[PastAction, ...]) -> str | None:
    """Return a stride along the flank before which the drone stands, to where it goes on; None where it does not."""
    side = passing(past)
    if not side:
        return None
    if len(past) < 2 or past[-2].kind != ROTATE:
        return _stride(0.0, side)
    left, right = seen.box.left < -_EDGE, seen.box.right > _EDGE
    if left == right:
        return None
    return _stride(-_EDGE if left else _EDGE, side)


def turn(past: tuple[PastAction, ...]) -> str | None:
    """Return a turn to what was passed and is no longer in the picture; None where nothing was."""
    return reply.rotate(-_TURN_DEG * passing(past)) if past and past[-1].kind == GO and passing(past) else None


def turned(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was such a turn: its flank must be right before the drone."""
    if len(past) < 2 or past[-1].kind != ROTATE or past[-2].kind != GO:
        return False
    return past[-1].angle_deg == -_TURN_DEG * passing(past)


def _stride(x: float, side: int) -> str:
    return reply.go(500.0 + 1000.0 * x, 500.0, _RIGHT_M if side > 0 else _LEFT_M)
