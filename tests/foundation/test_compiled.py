"""Processes that start at once compile one after the other, so that all but the first find it done."""

import fcntl
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import NumbaError

from foundation import compiled
from foundation.frames import wrap_pi


@pytest.mark.skipif(not compiled.CAN_CACHE, reason="nothing is kept here")
def test_one_at_a_time_compiles():
    with compiled.compile_lock(), (compiled.cache_folder() / "turn").open() as turn, pytest.raises(BlockingIOError):
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (compiled.cache_folder() / "turn").open() as turn:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_only_a_kernel_that_says_so_makes_arrays():
    def made(count):
        return np.zeros(count).sum()

    assert compiled.njit(cache=False, allocates=True)(made)(3) == 0.0
    with pytest.raises(NumbaError):
        compiled.njit(cache=False)(made)(3)


@given(st.floats(-50.0, 50.0))
def test_an_angle_within_a_revolution_is_wrapped_to_the_bits_of_a_division(angle):
    assert wrap_pi(angle) == (angle + math.pi) % (2.0 * math.pi) - math.pi
