"""Processes that start together compile one after another: the first one compiles, the others load its cache."""

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
def test_only_one_process_compiles_at_a_time():
    with compiled.compile_lock(), (compiled.cache_folder() / "turn").open() as turn, pytest.raises(BlockingIOError):
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (compiled.cache_folder() / "turn").open() as turn:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_kernel_may_allocate_arrays_only_with_allocates_set():
    def made(count):
        return np.zeros(count).sum()

    assert compiled.njit(cache=False, allocates=True)(made)(3) == 0.0
    with pytest.raises(NumbaError):
        compiled.njit(cache=False)(made)(3)


@given(st.floats(-50.0, 50.0))
def test_wrap_pi_equals_the_modulo_formula_bit_for_bit(angle):
    assert wrap_pi(angle) == (angle + math.pi) % (2.0 * math.pi) - math.pi
