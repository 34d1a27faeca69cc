"""The connected parts of a graph."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from episodes.maps.geometry import connected


@given(st.integers(1, 40), st.lists(st.tuples(st.integers(0, 39), st.integers(0, 39)), max_size=60))
def test_points_share_a_number_if_edges_lead_from_one_to_the_other(count, edges):
    a, b = np.array(edges, np.int64).reshape(-1, 2).T % count
    parts = [{point} for point in range(count)]  # one list entry per point; connected points share a set
    for one, other in zip(a.tolist(), b.tolist(), strict=True):
        joined = parts[one] | parts[other]
        for point in joined:
            parts[point] = joined
    first_points = sorted({min(part) for part in parts})
    assert connected(a, b, count).tolist() == [first_points.index(min(part)) for part in parts]
