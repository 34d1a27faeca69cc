"""What was claimed and was not it: to leave it, and not to come back at once.

A flight ends with the first claim that is true, so after one it goes on only where that was false. Of the last five
actions a turn of TURN_DEG says that something was left: it lies at the drone's back.
"""

import math

from dronecats.pilots import reply
from dronecats.pilots.briefing import PastAction
from dronecats.pilots.vision import paint, search
from dronecats.pilots.vision.sighting import Sighting
from foundation.protocol import FINISHED, ROTATE

TURN_DEG = 88.0  # from what was refused: it is no longer in the picture then, or at its edge
ROOM_M = 0.9  # kept between the drone and the thing's nearest end
NEARER_M = 2.4  # of a stride after a claim, at most: a target may go away at 0.3 m/s
_CLAIMS = 3  # of one thing, each from nearer
_NEAR_M = 10.0  # what is refused is no farther off when the drone has turned from it


def again(past: tuple[PastAction, ...]) -> bool:
    """Return whether enough claims have been made in what the history shows."""
    return sum(p.kind == FINISHED for p in past) >= _CLAIMS


def turn(past: tuple[PastAction, ...]) -> str:
    """Return a turn away from what was claimed: to the other side than the last one."""
    before = [p.angle_deg for p in past if p.kind == ROTATE]
    return reply.rotate(-math.copysign(TURN_DEG, before[-1]) if before else TURN_DEG)


def leaving(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was such a turn."""
    return bool(past) and past[-1].kind == ROTATE and abs(abs(past[-1].angle_deg) - TURN_DEG) < 0.05


def is_it(seen: Sighting, past: tuple[PastAction, ...]) -> bool:
    """Return whether a sighting just after the turn is of what was turned from: near, and on that side."""
    if not leaving(past) or seen.range.distance_m > _NEAR_M:
        return False
    return (seen.box.left if past[-1].angle_deg > 0.0 else -seen.box.right) < -0.5 + 0.01


def away(picture: paint.Picture) -> str:
    """Return a stride to where the view is open."""
    u, _ = search.way_out(picture)
    return reply.go(u, 500.0, search.WANDER_M)
