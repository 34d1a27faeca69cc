"""Tests the runs and episodes that commands read, and the pilot names of runs."""

from pathlib import Path

import pytest

from dronecats.report.recorded.run import RecordedRun, recorded_runs
from tests.report.results.archives import TWO
from tests.report.results.synthetic_runs import write_run


def test_named_episodes_of_one_run_are_all_read(tmp_path):
    run = write_run(tmp_path / "run", TWO)
    (read,) = recorded_runs([run / TWO[1], run / TWO[0]])
    assert [folder.name for folder in read.episodes] == sorted(TWO)
    (read,) = recorded_runs([run / TWO[0]])
    assert [folder.name for folder in read.episodes] == [TWO[0]]


def test_a_run_that_is_named_by_several_paths_is_read_once(tmp_path, monkeypatch):
    run = write_run(tmp_path / "run", TWO)
    (tmp_path / "link").symlink_to(run)
    monkeypatch.chdir(tmp_path)
    (read,) = recorded_runs([Path("run"), run, tmp_path / "link", Path("run") / TWO[0], run / "." / ".." / "run"])
    assert [folder.name for folder in read.episodes] == sorted(TWO)


def test_the_runs_of_a_benchmark_beside_other_runs_are_read(tmp_path):
    write_run(tmp_path / "alone", TWO[:1])
    write_run(tmp_path / "bench" / "oracle", TWO)
    (tmp_path / "bench" / "report").mkdir()
    read = recorded_runs([tmp_path])
    assert [(run.folder.name, len(run.episodes)) for run in read] == [("alone", 1), ("oracle", 2)]
    assert recorded_runs([tmp_path, tmp_path / "bench"]) == read


@pytest.mark.parametrize("harness", ["inspect", "gymnasium"])
def test_a_run_of_another_harness_has_no_built_in_pilot(tmp_path, harness):
    flight = {"outside": {"harness": harness, "name": "openai/gpt-5"}}
    run = RecordedRun(folder=tmp_path, configuration={"flight": flight}, episodes=())
    assert (run.pilot, run.is_model) == (f"{harness}:openai/gpt-5", True)
