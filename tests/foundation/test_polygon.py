import math

from hypothesis import given
from hypothesis import strategies as st

from foundation.polygon import Point, contains

NOOK = ((4.0, -2.0), (4.0, 2.0), (6.0, 2.0), (6.0, 1.0), (4.5, 1.0), (4.5, -1.0), (6.0, -1.0), (6.0, -2.0))
metres = st.floats(-20.0, 20.0)


def test_a_point_in_a_notch_of_the_polygon_is_outside():
    assert contains(NOOK, (4.2, 0.0))  # between the notch and the edge of the polygon
    assert not contains(NOOK, (5.0, 0.0))  # in the notch
    assert not contains(NOOK, (5.0, 3.0))


@given(
    st.lists(st.floats(0.0, 6.28), min_size=3, max_size=9, unique=True), st.tuples(metres, metres), st.integers(0, 8)
)
def test_a_convex_polygon_contains_the_points_left_of_all_its_edges(angles: list[float], point: Point, first: int):
    """The corners lie on a circle, in either direction, and the list may start at any corner."""
    ring = [(10.0 * math.cos(a), 10.0 * math.sin(a)) for a in sorted(angles)]
    sides = [
        (n2 - n1) * (point[1] - e1) - (e2 - e1) * (point[0] - n1)
        for (n1, e1), (n2, e2) in zip(ring, (*ring[1:], ring[0]), strict=True)
    ]
    if min(abs(side) for side in sides) < 1e-6:  # the result on an edge is undefined
        return
    inside = all(side > 0.0 for side in sides)
    turned = ring[first % len(ring) :] + ring[: first % len(ring)]
    assert [contains(each, point) for each in (ring, turned, ring[::-1])] == [inside] * 3
