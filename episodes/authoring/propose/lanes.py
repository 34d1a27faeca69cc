"""A stretch of a lane as a path that keeps to the ground between its waypoints."""

import itertools
import math
from collections.abc import Sequence

from foundation.frames import Vec3
from foundation.terrain import HeightField

LEG_M = 4.0  # longest leg
SHORTEST_M = 0.2
OFF_M = 0.012  # from the ground, at most, before heights are rounded
LOOK_M = 0.1  # between the points at which that is looked at


def stretch(waypoints: Sequence[Vec3], first_m: float, length_m: float, terrain: HeightField) -> tuple[Vec3, ...]:
    """Return waypoints (m, NED, rounded to millimetres) along a polyline from `first_m` on, over `length_m` of it."""
    flat = [(p[0], p[1]) for p in waypoints]
    marks = [0.0, *itertools.accumulate(math.dist(a, b) for a, b in itertools.pairwise(flat))]
    last_m = min(first_m + length_m, marks[-1])
    stops = [first_m, *(m for m in marks if first_m + SHORTEST_M < m < last_m - SHORTEST_M), last_m]
    points = [_along(flat, marks, s) for s in stops]
    found = [points[0]]
    for a, b in itertools.pairwise(points):
        legs = max(1, math.ceil(math.dist(a, b) / LEG_M))
        ends = [(a[0] + (b[0] - a[0]) * k / legs, a[1] + (b[1] - a[1]) * k / legs) for k in range(1, legs + 1)]
        for one in ends:
            found += _split(found[-1], one, terrain)
    return tuple((round(n, 3), round(e, 3), round(terrain.at(n, e), 3)) for n, e in found)


def _along(flat: list[tuple[float, float]], marks: list[float], s: float) -> tuple[float, float]:
    k = max(0, min(len(flat) - 2, next((i for i, m in enumerate(marks) if m > s), len(marks)) - 1))
    u = (s - marks[k]) / (marks[k + 1] - marks[k])
    return (flat[k][0] + u * (flat[k + 1][0] - flat[k][0]), flat[k][1] + u * (flat[k + 1][1] - flat[k][1]))


def _split(a: tuple[float, float], b: tuple[float, float], terrain: HeightField) -> list[tuple[float, float]]:
    """Return the points after `a` up to `b`, so many that straight lines between them keep to the ground."""
    span = math.dist(a, b)
    low, high = terrain.at(*a), terrain.at(*b)
    steps = max(2, math.ceil(span / LOOK_M))
    worst, where = 0.0, 0.5
    for k in range(1, steps):
        u = k / steps
        off = abs(low + u * (high - low) - terrain.at(a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1])))
        if off > worst:
            worst, where = off, u
    if worst <= OFF_M or span < 2 * SHORTEST_M:
        return [b]
    where = min(max(where, SHORTEST_M / span), 1.0 - SHORTEST_M / span)
    middle = (a[0] + where * (b[0] - a[0]), a[1] + where * (b[1] - a[1]))
    return [*_split(a, middle, terrain), *_split(middle, b, terrain)]
