"""Processes that start at once compile one after the other, so that all but the first find it done."""

import fcntl

import pytest

from foundation import compiled


@pytest.mark.skipif(not compiled.KEEPS, reason="nothing is kept here")
def test_one_at_a_time_compiles():
    with compiled.in_turn(), (compiled.cache_folder() / "turn").open() as turn, pytest.raises(BlockingIOError):
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with (compiled.cache_folder() / "turn").open() as turn:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
