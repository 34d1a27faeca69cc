"""Looking for what is not in sight: a full circle, then a walk to where the view is open, then again.

What a search has done so far it reads in the prompt's history, which shows five actions.
"""

import math

import cv2
import numpy as np

from dronecats.pilots import reply
from dronecats.pilots.briefing import PastAction
from dronecats.pilots.vision import paint
from foundation.protocol import GO, ROTATE

SWEEP_DEG = 60.0  # five of them and the first view are the full circle
_SECOND_SWEEP_DEG = 45.0  # a turn of this size says: the circle is closed, now looking for a way out
WANDER_M = 20.0  # a `go` of this depth says: to a new vantage point; distances of sightings are kept off it
_WANDERS = 3  # strides to a new vantage point, each up to 3 m
_OPEN = 0.62  # share of the column above the horizon that is sky, above which a direction counts as open


def search(picture: paint.Picture, past: tuple[PastAction, ...]) -> str:
    """Turn until the circle is closed, then walk to where the view is open, then turn again."""
    turns = trailing(past, ROTATE)
    if turns:
        side = math.copysign(1.0, past[-1].angle_deg)
        if turns < 5:
            return reply.rotate(side * SWEEP_DEG)
        leaving = sum(abs(abs(p.angle_deg) - _SECOND_SWEEP_DEG) < 1.0 for p in past)
        u, openness = way_out(picture)
        if openness >= _OPEN * (1.0 - 0.2 * leaving):
            return reply.go(u, 500.0, WANDER_M)
        return reply.rotate(side * _SECOND_SWEEP_DEG)
    wandered = wanders(past)
    if 0 < wandered < _WANDERS:
        u, openness = way_out(picture)
        if openness >= 0.5 * _OPEN:
            return reply.go(u, 500.0, WANDER_M)
    if wandered == 0 and past and past[-1].kind == GO:  # it was there a moment ago: first to the side it was on
        return reply.rotate(math.copysign(SWEEP_DEG, past[-1].x_px - 640.0))
    return reply.rotate(SWEEP_DEG)


def way_out(picture: paint.Picture) -> tuple[float, float]:
    """Return the direction (u, 0–1000) in which the view is most open, and how much of its column is sky, 0 … 1.

    Sky low over the horizon means that nothing tall stands there: along a street rather than into a house. Upright
    edges about the horizon mean posts, trunks and hedges at the drone's own height.
    """
    height, width = picture.shape[:2]
    about = cv2.cvtColor(picture[int(0.38 * height) : int(0.75 * height)], cv2.COLOR_BGR2GRAY)
    upright = (np.abs(cv2.Sobel(about, cv2.CV_32F, 1, 0)) > 90.0).mean(axis=0)
    upper = paint.sky(picture)[: height // 2]
    share = upper.mean(axis=0)
    window = max(3, width // 8)
    smooth, obstructed = (
        np.convolve(np.pad(row, window // 2, mode="edge"), np.ones(window) / window, mode="valid")[:width]
        for row in (share, upright)
    )
    # at equal openness straight ahead is preferred: no turn, and the view is centred
    prefer = smooth - 2.0 * obstructed - 0.05 * np.abs(np.linspace(-1.0, 1.0, width))
    column = int(np.argmax(prefer))
    return 1000.0 * (column + 0.5) / width, float(smooth[column])


def trailing(past: tuple[PastAction, ...], kind: str) -> int:
    """Return how many of the last actions were of this kind."""
    count = 0
    for action in reversed(past):
        if action.kind != kind:
            break
        count += 1
    return count


def wanders(past: tuple[PastAction, ...]) -> int:
    """Return how many of the last actions were strides to a new vantage point."""
    count = 0
    for action in reversed(past):
        if action.kind != GO or abs(action.depth_m - WANDER_M) > 0.3:
            break
        count += 1
    return count
