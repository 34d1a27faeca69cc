"""Whether one thing stands to another as a relation says, in the ground plane and as the drone sees it."""

import math
from collections.abc import Sequence

from dronecats.pilots.vision import expression

FloorPoint = tuple[float, float]  # m, right of the camera's axis and ahead

BESIDE_M = 12.0  # the farthest that is called beside, before or behind a thing
NEAREST_M = 25.0  # … and that is called the nearest to it


def fit(relation: str, spot: FloorPoint, landmarks: Sequence[FloorPoint], others: Sequence[FloorPoint] = ()) -> float:
    """Return 0 … 1: how well `spot` stands in the relation to the landmarks, seen from (0, 0).

    `others` are the places of what else is of its kind: the nearest is the one of them that is.
    """
    if relation == expression.NEAREST:
        return _nearest(spot, landmarks[0], others)
    if relation == expression.BETWEEN:
        return _between(spot, landmarks[0], landmarks[1])
    beyond, right = _beside(spot, landmarks[0])
    away = math.hypot(beyond, right)
    near = _ramp(away, BESIDE_M + 8.0, BESIDE_M)
    if relation in (expression.LEFT, expression.RIGHT):
        side = right if relation == expression.RIGHT else -right
        return near * _ramp(side, 0.0, 1.0) * _ramp(abs(beyond), 2.4 * max(side, 0.4), 1.1 * max(side, 0.4))
    way = beyond if relation == expression.BEHIND else -beyond
    return near * _ramp(way, 0.0, 1.2) * _ramp(abs(right), 1.5 * max(way, 0.5), 0.5 * max(way, 0.5))


def _nearest(spot: FloorPoint, landmark: FloorPoint, others: Sequence[FloorPoint]) -> float:
    away = math.dist(spot, landmark)
    least = min((math.dist(one, landmark) for one in others), default=math.inf)
    return _ramp(away, 1.4 * NEAREST_M, NEAREST_M) * _ramp(away, 1.6 * least + 1.0, least)


def _between(spot: FloorPoint, a: FloorPoint, b: FloorPoint) -> float:
    span = max(math.dist(a, b), 1e-6)
    along = ((spot[0] - a[0]) * (b[0] - a[0]) + (spot[1] - a[1]) * (b[1] - a[1])) / span**2
    aside = abs((spot[0] - a[0]) * (b[1] - a[1]) - (spot[1] - a[1]) * (b[0] - a[0])) / span
    wide = max(1.5, 0.2 * span)
    return _ramp(abs(along - 0.5), 0.6, 0.4) * _ramp(aside, 2.0 * wide, wide)


def _beside(spot: FloorPoint, landmark: FloorPoint) -> tuple[float, float]:
    """Return how far (m) a spot is beyond the landmark and to the right of it, for who looks at the landmark."""
    way = math.hypot(*landmark) or 1.0
    ahead = (landmark[0] / way, landmark[1] / way)
    off = (spot[0] - landmark[0], spot[1] - landmark[1])
    return off[0] * ahead[0] + off[1] * ahead[1], off[0] * ahead[1] - off[1] * ahead[0]


def _ramp(value: float, none: float, full: float) -> float:
    """Return 0 at `none` and beyond, 1 at `full` and beyond, and in between what lies between."""
    if none == full:
        return float(value >= full)
    return min(max((value - none) / (full - none), 0.0), 1.0)
