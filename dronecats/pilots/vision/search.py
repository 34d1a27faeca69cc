"""Searches for a target that is not in the picture, and turns away from a wrong target.

A search is a full circle of turns, strides in the direction with the most open view, and another circle. A declaration
that did not end the flight was wrong. At a thing of the named colour, the drone declares up to three times, each time
from a shorter distance. Then it turns away by LEAVE_TURN_DEG and ignores that thing. The prompt's history of five
actions gives the state of the search.
"""

import math
from itertools import takewhile

import cv2
import numpy as np

from dronecats.pilots import actions
from dronecats.pilots.actions import PastAction
from dronecats.pilots.vision import colors
from dronecats.pilots.vision.color_detector import Detection
from foundation.protocol import GO, ROTATE

SWEEP_DEG = 60.0
CIRCLE_TURNS = 5  # turns of a full search circle: with the first view, six views
_SECOND_SWEEP_DEG = 45.0  # turn after a closed circle, to look for an open direction
WANDER_M = 20.0  # a `go` of this depth is a stride to a new vantage point; see avoid_wander_depth
_WANDERS = 3  # strides to a new vantage point, each up to 3 m
_OPEN = 0.62  # a direction is open if the sky covers at least this share above the horizon
LEAVE_TURN_DEG = 88.0  # turn away from a wrong target, to bring it to the edge of the picture or out of it
CLEARANCE_M = 0.9  # m, distance that the drone keeps from the nearest end of the thing
CLOSER_STRIDE_M = 2.4  # m, longest stride after a wrong declaration; it gains on a target that moves at 0.3 m/s
MOST_DECLARATIONS = 3  # the pilot declares at most this often at one thing
_REJECTED_WITHIN_M = 10.0  # m; after the turn, a thing farther away than this is not the wrong target


def next_action(picture: colors.Picture, past: tuple[PastAction, ...]) -> str:
    """Return the next search action: turns until the circle is closed, strides in an open direction, then new turns."""
    turns = count_trailing(past, ROTATE)
    if turns:
        side = math.copysign(1.0, past[-1].angle_deg)
        if turns < CIRCLE_TURNS:
            return actions.rotate(side * SWEEP_DEG)
        way_out_turns = sum(abs(abs(p.angle_deg) - _SECOND_SWEEP_DEG) < 1.0 for p in past)
        u, openness = open_direction(picture)
        if openness >= _OPEN * (1.0 - 0.2 * way_out_turns):
            return actions.go(u, 500.0, WANDER_M)
        return actions.rotate(side * _SECOND_SWEEP_DEG)
    wander_strides = count_wander_strides(past)
    if 0 < wander_strides < _WANDERS:
        u, openness = open_direction(picture)
        if openness >= 0.5 * _OPEN:
            return actions.go(u, 500.0, WANDER_M)
    if wander_strides == 0 and past and past[-1].kind == GO:  # the target was just lost: turn to its last side
        return actions.rotate(math.copysign(SWEEP_DEG, past[-1].x_px - 640.0))
    return actions.rotate(SWEEP_DEG)


def open_direction(picture: colors.Picture) -> tuple[float, float]:
    """Return the direction (u, 0–1000) with the most open view, and the share of sky there, 0 … 1.

    Sky just above the horizon means that nothing tall stands there. Upright edges near the horizon mean posts, trunks
    and hedges at the drone's height.
    """
    height, width = picture.shape[:2]
    middle = cv2.cvtColor(picture[int(0.38 * height) : int(0.75 * height)], cv2.COLOR_BGR2GRAY)
    upright = (np.abs(cv2.Sobel(middle, cv2.CV_32F, 1, 0)) > 90.0).mean(axis=0)
    upper = colors.sky(picture)[: height // 2]
    share = upper.mean(axis=0)
    window = max(3, width // 8)
    smooth, obstructed = (
        np.convolve(np.pad(row, window // 2, mode="edge"), np.ones(window) / window, mode="valid")[:width]
        for row in (share, upright)
    )
    # at equal openness prefer straight ahead: it needs no turn
    preference = smooth - 2.0 * obstructed - 0.05 * np.abs(np.linspace(-1.0, 1.0, width))
    column = int(np.argmax(preference))
    return 1000.0 * (column + 0.5) / width, float(smooth[column])


def count_trailing(past: tuple[PastAction, ...], kind: str) -> int:
    """Return the number of actions of one kind at the end of the history."""
    return len(list(takewhile(lambda action: action.kind == kind, reversed(past))))


def count_wander_strides(past: tuple[PastAction, ...]) -> int:
    """Return the number of strides to a new vantage point at the end of the history."""
    return len(list(takewhile(lambda a: a.kind == GO and abs(a.depth_m - WANDER_M) <= 0.3, reversed(past))))


def avoid_wander_depth(depth_m: float) -> float:
    """Return a depth that later steps do not mistake for a stride to a new vantage point."""
    return depth_m if abs(depth_m - WANDER_M) > 0.5 else WANDER_M - 1.0


def turn_away(past: tuple[PastAction, ...]) -> str:
    """Return a turn away from a wrong target, opposite to the last turn; to the right without an earlier turn."""
    before = [p.angle_deg for p in past if p.kind == ROTATE]
    return actions.rotate(-math.copysign(LEAVE_TURN_DEG, before[-1]) if before else LEAVE_TURN_DEG)


def has_turned_away(past: tuple[PastAction, ...]) -> bool:
    """Return whether the last action was a turn away from a wrong target."""
    return bool(past) and past[-1].kind == ROTATE and abs(abs(past[-1].angle_deg) - LEAVE_TURN_DEG) < 0.05


def is_rejected(detection: Detection, past: tuple[PastAction, ...]) -> bool:
    """Return whether a detection right after a turn away is the wrong target.

    A near detection is the wrong target if it touches the edge of the picture on the side that the drone turned from.
    """
    if not has_turned_away(past) or detection.range.distance_m > _REJECTED_WITHIN_M:
        return False
    return (detection.box.left if past[-1].angle_deg > 0.0 else -detection.box.right) < -0.5 + 0.01
