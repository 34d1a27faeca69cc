"""Paths over the ground: from the few places that a person clicks to the waypoints that follow it, and back."""

import itertools
import math
from collections.abc import Callable, Sequence

from dronecats.border.frames import Vec3

OFF_M = 0.005  # how far a path may leave the ground between two of its waypoints
STEP_M = 0.25  # between the places at which the ground is looked at

Place = tuple[float, float]  # m north, m east


def draped(knots: Sequence[Place], on_ground: Callable[[float, float], Vec3]) -> tuple[Vec3, ...]:
    """Return waypoints (m, NED) through knots, with more where the ground between two leaves the straight line."""
    points = [on_ground(*knots[0])]
    for a, b in itertools.pairwise(knots):
        count = max(1, math.ceil(math.dist(a, b) / STEP_M))
        shares = [k / count for k in range(count + 1)]
        fine = [on_ground(a[0] + (b[0] - a[0]) * u, a[1] + (b[1] - a[1]) * u) for u in shares]
        points.extend(fine[k] for k in _needed(fine)[1:])
    return tuple(points)


def corners(points: Sequence[Place]) -> tuple[Place, ...]:
    """Return the points of a line seen from above at which it turns, with its ends."""
    kept = [points[0]]
    for a, b in itertools.pairwise(points[1:]):
        (n0, e0), (n1, e1), (n2, e2) = kept[-1], a, b
        aside = abs((n1 - n0) * (e2 - e0) - (e1 - e0) * (n2 - n0)) / max(math.dist((n0, e0), (n2, e2)), 1e-9)
        if aside > 0.002:  # places are rounded to the millimetre
            kept.append(a)
    return (*kept, points[-1])


def _needed(points: Sequence[Vec3]) -> list[int]:
    """Return which points of a straight leg, evenly spaced, must stay for none to lie off the line between those."""
    kept = {0, len(points) - 1}
    waiting = [(0, len(points) - 1)]
    while waiting:
        a, b = waiting.pop()
        first, last = points[a][2], points[b][2]
        off = {k: abs(points[k][2] - (first + (last - first) * (k - a) / (b - a))) for k in range(a + 1, b)}
        worst = max(off, key=off.__getitem__, default=a)
        if off and off[worst] > OFF_M:
            kept.add(worst)
            waiting += [(a, worst), (worst, b)]
    return sorted(kept)
