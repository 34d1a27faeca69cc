"""The folder of a run of many episodes: it resumes, never mixes settings, and deletes nothing."""

import dataclasses
import json
import re
from typing import Any

import pytest

from dronecats.bench.campaign import Batch
from dronecats.bench.tables import audit_table, groups, score_row, solved_steps
from dronecats.report.writers import as_terminal
from episodes.records import catalogue
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.results import Result

FIRST, SECOND, *OTHERS = catalogue.ids()


def judged(batch, episode, outcome):
    folder = batch.fresh(episode)
    (folder / "episode.json").write_text(catalogue.load(episode).to_json())
    (folder / "verdict.json").write_text(json.dumps({"outcome": outcome, "steps": 3}))
    return folder


def test_only_scored_episodes_are_done(tmp_path):
    batch = Batch(tmp_path / "run", {"pilot": "oracle"})
    broken, torn, nested, empty, absent = OTHERS[:5]
    judged(batch, FIRST, "success")
    judged(batch, SECOND, "failure")
    judged(batch, broken, "error")
    (judged(batch, torn, "success") / "verdict.json").write_text('{"outcome": "succ')  # killed while it was written
    (judged(batch, nested, "success") / "verdict.json").write_text("[" * 100_000)
    batch.fresh(empty)
    batch.close()
    again = Batch(tmp_path / "run", {"pilot": "oracle"})
    assert again.left([FIRST, SECOND, *OTHERS[:5]]) == [broken, torn, nested, empty, absent]


def test_an_episode_file_is_stored_under_its_id_and_flown_again_after_a_change(tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(catalogue.load(FIRST).to_json())
    batch = Batch(tmp_path / "run", {})
    folder = judged(batch, str(file), "success")
    assert folder == batch.folder(FIRST) == tmp_path / "run" / FIRST
    batch.close()
    again = Batch(tmp_path / "run", {})
    assert again.left([str(file), str(folder)]) == []
    again.close()
    file.write_text(dataclasses.replace(catalogue.load(FIRST), instruction="fly home").to_json())
    assert Batch(tmp_path / "run", {}).left([str(file)]) == [str(file)]


def test_a_second_attempt_keeps_the_first(tmp_path):
    batch = Batch(tmp_path / "run", {})
    for attempt in ("one", "two", "three"):
        (batch.fresh(FIRST) / "decisions.jsonl").write_text(attempt)
    kept = sorted((tmp_path / "run" / layout.UNFINISHED).glob(f"{FIRST}-*/decisions.jsonl"))
    assert [path.read_text() for path in kept] == ["one", "two"]
    assert (tmp_path / "run" / FIRST / "decisions.jsonl").read_text() == "three"


def test_a_run_with_other_settings_is_not_resumed(tmp_path):
    Batch(tmp_path / "run", {"pilot": "oracle", "seed": 0}).close()
    with pytest.raises(UsageError, match=r"\bseed\b"):
        Batch(tmp_path / "run", {"pilot": "oracle", "seed": 1})


def test_settings_are_compared_in_their_json_form(tmp_path):
    Batch(tmp_path / "run", {"envelope": {"exclusions": ((1.0, 2.0),)}}).close()
    Batch(tmp_path / "run", {"envelope": {"exclusions": ((1.0, 2.0),)}}).close()
    with pytest.raises(UsageError, match=r"\benvelope\b"):
        Batch(tmp_path / "run", {"envelope": {"exclusions": ()}})


def test_a_run_folder_cannot_be_opened_twice(tmp_path):
    first = Batch(tmp_path / "run", {})
    with pytest.raises(UsageError, match=f"{tmp_path}/run"):
        Batch(tmp_path / "run", {})
    first.close()
    Batch(tmp_path / "run", {}).close()


def test_a_folder_with_other_content_is_rejected(tmp_path):
    (tmp_path / "thesis.txt").write_text("three years of work")
    with pytest.raises(UsageError, match=r"run\.json"):
        Batch(tmp_path, {})


def test_the_error_for_an_impossible_folder_names_it(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=f"{tmp_path}/file"):
        Batch(tmp_path / "file" / "run", {})


def results():
    rows: list[tuple[str, Any, int]] = [
        ("residential-tracking", "success", 4),
        ("residential-search-and-track", "success", 9),
    ]
    rows += [("campus-approaching", "failure", 30), ("residential-tracking", "error", 1)]
    return [Result(episode=f"{g}-{k:02d}", outcome=o, steps=s) for k, (g, o, s) in enumerate(rows, 1)]


def test_errors_are_not_scored():
    rows = {name: score_row(name, members) for name, members in groups(results()).items()}
    assert (rows["residential-tracking"].solved, rows["residential-tracking"].flown) == (1, 1)
    assert rows["residential-tracking"].errors == 1
    assert (rows["all"].solved, rows["all"].flown, rows["all"].errors) == (2, 3, 1)
    assert rows["all"].median_steps == 6.5


def test_cells_are_separate_rows_in_the_order_of_the_paper():
    rows = [score_row(name, members) for name, members in groups(results()).items()]
    names = [row.name for row in rows]
    assert names[:3] == ["campus-approaching", "residential-tracking", "residential-search-and-track"]
    assert re.search(r"\b1 error\b", as_terminal(audit_table(rows, {})))


def test_only_solved_episodes_have_a_par():
    assert solved_steps(results()) == {"residential-tracking-01": 4, "residential-search-and-track-02": 9}
