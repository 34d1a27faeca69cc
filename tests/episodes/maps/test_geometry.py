"""The connected parts of a graph, compared with scipy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from episodes.maps.geometry import connected


@given(st.integers(1, 40), st.lists(st.tuples(st.integers(0, 39), st.integers(0, 39)), max_size=60))
def test_connected_parts_and_their_numbers_are_those_of_scipy(count, edges):
    a, b = np.array(edges, np.int64).reshape(-1, 2).T % count
    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    assert connected(a, b, count).tolist() == connected_components(links, directed=False)[1].tolist()
