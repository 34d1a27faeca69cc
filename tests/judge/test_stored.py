"""Tests the comparison of verdict.json with the logs, and the exit status of `dronecats judge`."""

import json

import pytest

from dronecats.cli.main import main
from tests.judge.episode_logs import BEGIN, END, decision, frame, judge_folder, pose, write, write_verdict

DECISIONS = [decision(0, 0, 5.0, reply='{"action": "finished"}'), decision(1, 1, 9.0, "think", reply="{")]
DECISIONS[1] = {**DECISIONS[1], "action": None}
TRUTH = [BEGIN, *(pose(k / 2, 9.0 - k / 10) for k in range(30)), frame(0, 4.5, 4.0), frame(1, 8.5, 4.0), END]


@pytest.fixture
def folder(tmp_path):
    episode = write(tmp_path / "run" / "e", DECISIONS, TRUTH)
    write_verdict(episode)
    return episode


def leaves(value, path=()):
    """Return the path of every leaf in a JSON value: numbers, texts, booleans and null."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    paths = [leaf for key, child in inner for leaf in leaves(child, (*path, key))]
    return paths or ([path] if not isinstance(value, dict | list) else [])


def forged(verdict, path, change):
    copy = json.loads(json.dumps(verdict))
    at = copy
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = change(at[path[-1]])
    return copy


def other(value):
    return not value if isinstance(value, bool) else value + 0.01 if isinstance(value, int | float) else "forged"


def test_every_field_is_compared(folder, capsys):
    stored = json.loads((folder / "verdict.json").read_text())
    assert len(leaves(stored)) > 30
    for path in leaves(stored):
        if path != ("delta_m",):  # a verdict for another radius is not compared
            (folder / "verdict.json").write_text(json.dumps(forged(stored, path, other)))
            assert judge_folder(folder)["stored_agrees"] is False, path
    assert main(["judge", str(folder.parent)]) == 4
    assert "drones[0].untraced_s" in capsys.readouterr().out
    (folder / "verdict.json").write_text(json.dumps(stored))
    assert main(["judge", str(folder.parent)]) == 0


def test_numbers_agree_within_their_rounding(folder):
    stored = json.loads((folder / "verdict.json").read_text())
    close = forged(stored, ("diagnostics", "dwell_s"), lambda s: s + 0.001)
    (folder / "verdict.json").write_text(json.dumps(close))
    assert judge_folder(folder)["stored_agrees"] is True
    (folder / "verdict.json").write_text(json.dumps({**stored, "steps": 2.0}))
    assert judge_folder(folder)["stored_agrees"] is True
    (folder / "verdict.json").write_text(json.dumps({**stored, "success": 1}))
    assert judge_folder(folder)["stored_differs"] == ["success"]


def test_the_text_of_an_error_is_not_compared(folder):
    (folder / "truth.jsonl").write_text("")  # nothing was measured
    write_verdict(folder)
    stored = json.loads((folder / "verdict.json").read_text())
    assert stored["outcome"] == "error"
    (folder / "verdict.json").write_text(json.dumps({**stored, "error": "in other words"}))
    assert judge_folder(folder)["stored_agrees"] is True
    (folder / "verdict.json").write_text(json.dumps({**stored, "error": None}))
    assert judge_folder(folder)["stored_differs"] == ["error"]


OLD = {"outcome": "success", "success": True, "ne_m": 4.0, "delta_m": 5.0, "steps": 2, "declarations": 1,
       "declarations_after_cap": 0, "deciding": {"step": 0, "drone": 0, "t": 5.0, "distance_m": 4.0}, "error": None,
       "diagnostics": {"dwell_s": 0, "longest_loss_s": 0.5}}  # fmt: skip


def test_verdicts_of_older_versions_are_compared_by_the_fields_that_they_have(folder, capsys):
    (folder / "verdict.json").write_text(json.dumps(OLD))
    assert main(["judge", str(folder)]) == 0
    (folder / "verdict.json").write_text(json.dumps({**OLD, "outcome": "error", "success": False}))
    assert main(["judge", str(folder)]) == 4
    assert "outcome, success" in capsys.readouterr().out


def test_a_truncated_verdict_file_differs(folder):
    (folder / "verdict.json").write_text('{"outcome": "succ')
    assert main(["judge", str(folder)]) == 4


def test_missing_verdicts_and_other_radii_are_not_compared(folder, capsys):
    assert main(["judge", str(folder), "--delta", "4"]) == 0
    (folder / "verdict.json").unlink()
    assert main(["judge", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["episodes"]["e"]["stored_agrees"] is None


def test_an_action_that_differs_from_its_reply_is_reported(folder, capsys):
    write(folder, [DECISIONS[0], {**DECISIONS[1], "action": {"action": "finished"}}], TRUTH)
    write_verdict(folder)  # forged together with the log
    assert main(["judge", str(folder)]) == 4
    assert "step 1" in capsys.readouterr().out
