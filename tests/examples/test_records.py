"""No training record is an episode of the benchmark."""

from dataclasses import replace

import pytest

from episodes.authoring.propose.proposals import propose
from episodes.records import catalogue
from examples.action_head import records
from foundation.errors import UsageError


def test_requests_use_map_seeds_and_ids_that_no_benchmark_episode_uses():
    requests = records.requests()
    shipped = {(request.map, request.map_seed) for request in map(catalogue.load, catalogue.all_ids())}
    assert not {(request.map, request.map_seed) for request in requests} & shipped
    ids = [
        f"{request.map}-{request.cell}-{request.first + k:02d}" for request in requests for k in range(request.count)
    ]
    assert len(ids) == len(set(ids)) == 448
    assert not set(ids) & set(catalogue.all_ids())


def test_a_small_share_of_the_requests_covers_all_maps_and_cells():
    first = records.requests(0.05)
    assert {(one.map, one.cell) for one in first} == {(m, c) for m in ("residential", "campus") for c in records.CELLS}
    assert first == records.requests()[: len(first)]


def test_drafted_records_are_new():
    """The request is a real one, but with a count of 1."""
    made = propose(replace(records.requests()[0], count=1))
    records.must_be_new(made)
    assert made[0].map_seed == records.FIRST_MAP_SEED


def test_benchmark_episodes_are_rejected():
    shipped = catalogue.load("residential-approaching-01")
    for changed, part in (
        (shipped, "map"),
        (replace(shipped, map_seed=2), r"^(?!.*\b(map|start)\b).*seed"),
        (replace(shipped, map_seed=2, seed=5), "start"),
    ):
        with pytest.raises(UsageError, match=part):
            records.must_be_new([changed])


def test_invalid_shares_and_job_counts_are_rejected(tmp_path):
    for words in (["--share", "0"], ["--share", "1.5"], ["--share", "nan"], ["--jobs", "0"]):
        with pytest.raises(UsageError, match=words[0]):
            records.main(["--out", str(tmp_path / "out"), *words])
        assert not (tmp_path / "out").exists(), words


def test_an_output_folder_that_cannot_be_created_is_reported(monkeypatch, tmp_path):
    record = replace(catalogue.load("residential-approaching-01"), map_seed=2, seed=5, instruction="Go elsewhere.")
    monkeypatch.setattr(records, "process_map", lambda *_: [[record]])
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="file/out"):
        records.write(tmp_path / "file" / "out", 1.0, 1)
