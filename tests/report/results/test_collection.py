"""Tests the rows of episodes whose logs are damaged."""

from pathlib import Path

from dronecats.report.results.collection import collect
from dronecats.report.tables import outcomes
from tests.report.results.synthetic_runs import write_run
from tests.report.small import line, made, small

IDS = ("campus-searching-01", "residential-approaching-01")


def damage_log(episode: Path) -> None:
    log = episode / "truth.jsonl"
    log.write_text("{}\n" + log.read_text())


def test_an_episode_with_a_damaged_log_is_not_scored_in_the_cell_of_its_record(tmp_path):
    run = write_run(tmp_path / "oracle", IDS)
    (whole, _) = collect([run]).episodes
    damage_log(run / IDS[0])
    (run / IDS[0]).rename(run / "renamed")
    collection = collect([run])
    (damaged,) = (flight for flight in collection.episodes if flight.verdict is None)
    assert (damaged.episode, damaged.map, damaged.cell) == (IDS[0], "campus", "searching")
    assert damaged.record_sha256 == whole.record_sha256
    row = line(made(outcomes.main, small(collection)), "oracle")
    assert (row["flights"].value, row["not_scored"].value) == (1, 1)
    assert "searching_success_percent" in row


def test_an_episode_with_damaged_logs_and_a_damaged_record_has_the_name_of_its_folder(tmp_path):
    run = write_run(tmp_path / "oracle", IDS[:1])
    damage_log(run / IDS[0])
    (run / IDS[0] / "episode.json").write_text("{")
    (damaged,) = collect([run]).episodes
    assert (damaged.episode, damaged.map, damaged.cell, damaged.record_sha256) == (IDS[0], "", "", "")
