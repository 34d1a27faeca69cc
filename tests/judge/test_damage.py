"""Tests that a damaged log is judged, or that its damage is reported in one sentence."""

import json
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronecats.judge.episode import log_contradictions
from foundation.errors import UsageError
from foundation.run_folder.reading import read
from tests.judge.episode_logs import BEGIN, END, decision, frame, judge_run, outcome, pose, write, write_verdict

DECISIONS = [decision(0, 0, 5.0, "go"), decision(1, 1, 9.0), decision(2, 2, 12.0, None)]
TARGET = {"target_ned": [10.0, 0.0, 0.0]}
TRUTH = [
    {**BEGIN, "cap_s": 300.0, "source": None},
    frame(0, 4.5, 9.0, position_ned=[1.0, 0.0, 0.0], **TARGET),
    frame(1, 8.5, 6.0, position_ned=[4.0, 0.0, 0.0], **TARGET),
    pose(5.0, 9.0, place=[1.0, 0.0, 0.0], **TARGET),
    pose(5.5, 9.0, place=[1.0, 0.0, 0.0], **TARGET),
    frame(2, 11.5, 6.0),
    END,
]

JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4) | st.sampled_from(["begin", "pose"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["action", "t", "x"]), inner),
    max_leaves=4,
)
GONE = object()
PLACES = [(name, n, key) for name, rows in (("decisions", DECISIONS), ("truth", TRUTH)) for n, row in enumerate(rows)
          for key in row]  # fmt: skip


def changed(rows, number, key, value):
    row = {name: old for name, old in rows[number].items() if name != key}
    return [*rows[:number], row if value is GONE else {**row, key: value}, *rows[number + 1 :]]


def judged(folder, place, value):
    """Judge logs with one changed key, alone and next to an undamaged episode."""
    name, number, key = place
    decisions = changed(DECISIONS, number, key, value) if name == "decisions" else DECISIONS
    truth = changed(TRUTH, number, key, value) if name == "truth" else TRUTH
    write(folder / "whole", DECISIONS, TRUTH)
    damaged = write(folder / "damaged", decisions, truth)
    try:
        logs = read(damaged)
        for delta_m in (5.0, 7.0):
            json.dumps(outcome(logs, delta_m), allow_nan=False)
        log_contradictions(logs)
        message = None
    except UsageError as damage:
        message = str(damage)
    assert message is None or (f"{name}.jsonl" in message and "\n" not in message)
    verdicts = judge_run(folder)
    assert verdicts["whole"]["outcome"] == "failure"
    return verdicts["damaged"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=300)
@given(st.sampled_from(PLACES), JSON)
def test_any_value_of_any_key_is_judged_or_reported(tmp_path, place, value):
    judged(tmp_path, place, value)


def test_any_missing_key_is_judged_or_reported(tmp_path):
    for place in PLACES:
        verdict = judged(tmp_path, place, GONE)
        needed = place[2] not in ("reply", "error", "target_ned", "cap_s", "source") and not (
            (place[2] == "position_ned" and TRUTH[place[1]]["kind"] == "frame") or place == ("truth", 0, "t")
        )
        assert ("damaged" in (verdict["error"] or "")) == needed, place


def test_impossible_values_are_damage(tmp_path):
    for place, value in [
        (("truth", 1, "visible"), 1),
        (("truth", 3, "visible"), 0),
        (("truth", 2, "distance_m"), -0.1),
        (("truth", 3, "distance_m"), True),
        (("truth", 6, "t"), "300"),
        (("truth", 0, "t0_us"), 1.5),
        (("truth", 0, "cap_s"), -1),
        (("decisions", 1, "t_decided"), 8.4),
        (("decisions", 1, "drone"), 255),
        (("decisions", 1, "step"), -1),
    ]:
        name, number, key = place
        error = judged(tmp_path, place, value)["error"]
        assert re.search(rf"{name}\.jsonl line {number + 1} .*\b{key}\b", error), place


def test_a_frame_may_be_one_tick_newer_than_its_decision(tmp_path):
    assert judged(tmp_path, ("decisions", 0, "t_decided"), 4.47)["error"] is None


def test_a_damaged_last_line_is_an_error_and_a_torn_one_is_omitted(tmp_path):
    folder = write(tmp_path / "e", DECISIONS, TRUTH)
    (folder / "truth.jsonl").write_text((folder / "truth.jsonl").read_text() + json.dumps({**END, "t": None}))
    with pytest.raises(UsageError, match=r"truth\.jsonl.*\bt\b"):
        read(folder)
    (folder / "truth.jsonl").write_text((folder / "truth.jsonl").read_text()[:-1])
    assert outcome(read(folder))["outcome"] == "failure"


def test_two_different_truth_rows_of_one_frame_are_damage(tmp_path):
    folder = write(tmp_path / "e", DECISIONS, [*TRUTH, frame(2, 11.5, 6.0)])
    assert outcome(read(folder))["outcome"] == "failure"
    write(folder, DECISIONS, [*TRUTH, frame(2, 11.5, 5.0)])
    with pytest.raises(UsageError, match="frame 2"):
        read(folder)


def test_damage_is_stored_as_an_error(tmp_path):
    folder = write(tmp_path / "e", DECISIONS, [*TRUTH[:2], {"kind": "frame"}, *TRUTH[2:]])
    assert write_verdict(folder)["outcome"] == "error"
    stored = json.loads((folder / "verdict.json").read_text())
    assert "line 3" in stored["error"]
    assert stored["success_at_first"] is None
    assert judge_run(folder)["e"]["stored_agrees"] is True
