"""Nothing that is learnt from is an episode of the benchmark."""

from dataclasses import replace

import pytest

from episodes.authoring.propose.proposals import propose
from episodes.records import catalogue
from examples.action_head import records
from foundation.errors import UsageError


def test_requests_are_of_other_maps_and_their_ids_are_their_own():
    asked = records.requests()
    shipped = {(one.map, one.map_seed) for one in map(catalogue.load, catalogue.all_ids())}
    assert not {(one.map, one.map_seed) for one in asked} & shipped
    ids = [f"{one.map}-{one.cell}-{one.first + k:02d}" for one in asked for k in range(one.count)]
    assert len(ids) == len(set(ids)) == 448
    assert not set(ids) & set(catalogue.all_ids())


def test_any_beginning_is_mixed():
    first = records.requests(0.05)
    assert {(one.map, one.cell) for one in first} == {(m, c) for m in ("residential", "campus") for c in records.CELLS}
    assert first == records.requests()[: len(first)]


def test_what_is_drafted_is_new():
    """A request as it is made, but for its length."""
    made = propose(replace(records.requests()[0], count=1))
    records.must_be_new(made)
    assert made[0].map_seed == records.FIRST_MAP_SEED


def test_an_episode_of_the_benchmark_is_refused():
    shipped = catalogue.load("residential-approaching-01")
    for changed, part in (
        (shipped, "map"),
        (replace(shipped, map_seed=2), r"^(?!.*\b(map|start)\b).*seed"),
        (replace(shipped, map_seed=2, seed=5), "start"),
    ):
        with pytest.raises(UsageError, match=part):
            records.must_be_new([changed])


def test_a_count_that_is_none_is_refused(tmp_path):
    for words in (["--share", "0"], ["--share", "1.5"], ["--share", "nan"], ["--jobs", "0"]):
        with pytest.raises(UsageError, match=words[0]):
            records.main(["--out", str(tmp_path / "out"), *words])
        assert not (tmp_path / "out").exists(), words
