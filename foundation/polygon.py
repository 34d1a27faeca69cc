"""Polygons on the ground plane."""

from collections.abc import Sequence

Point = tuple[float, float]  # m north, m east


def contains(polygon: Sequence[Point], point: Point) -> bool:
    """Return whether a point lies in a simple polygon: a ray to the east crosses its edges an odd number of times."""
    north, east = point
    inside = False
    n1, e1 = polygon[-1]
    for n2, e2 in polygon:
        if (n1 > north) != (n2 > north) and east < e1 + (north - n1) / (n2 - n1) * (e2 - e1):
            inside = not inside
        n1, e1 = n2, e2
    return inside
