import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dronecats.judge import judged_flight
from foundation.errors import UsageError
from foundation.run_folder.reading import read
from tests.judge.episode_logs import (
    BEGIN,
    DECIDED,
    END,
    decision,
    frame,
    judge_folder,
    judge_run,
    logs,
    outcome,
    pose,
    write,
    write_verdict,
)


@pytest.fixture
def folder(tmp_path):
    return lambda decisions, truth, name="e": write(tmp_path / name, decisions, truth)


def test_a_declaration_is_measured_at_its_own_frame(folder):
    path = folder(
        [decision(0, 7, 10.0, "go"), decision(1, 8, 20.0)],
        [BEGIN, pose(0, 16), frame(7, 9.5, 12.0), frame(8, 19.5, 4.4), pose(20, 9.0), END],
    )
    verdict = judge_folder(path)
    assert verdict["outcome"] == "success"
    assert verdict["ne_m"] == 4.4
    assert verdict["steps"] == 2
    assert verdict["declarations"] == 1
    assert verdict["diagnostics"]["start_distance_m"] == 16


def test_declarations_after_the_cap_change_nothing(folder):
    late = [decision(i, i, 502.0 + 5 * i) for i in range(1, 8)]
    path = folder(
        [decision(0, 0, 299.0, "go"), *late],
        [BEGIN, frame(0, 298.5, 7.0), *(frame(i, 500.0, 2.0) for i in range(1, 8)), END],
    )
    verdict = judge_folder(path)
    assert verdict["outcome"] == "failure"
    assert verdict["ne_m"] == 7.0
    assert verdict["declarations"] == 0
    assert verdict["declarations_after_cap"] == 7


def test_another_radius_changes_the_verdict_of_a_stored_flight(folder):
    path = folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 6.0), END])
    assert judge_folder(path)["outcome"] == "failure"
    assert judge_folder(path, 6.5)["outcome"] == "success"


def test_broken_flights_are_errors_and_never_failures(folder):
    decisions, truth = [decision(0, 0, 5.0, "go")], [BEGIN, frame(0, 4.5, 9.0)]
    assert judge_folder(folder(decisions, truth))["outcome"] == "error"  # the logger was killed
    broken = {**END, "reason": "error", "error": "the model endpoint broke off"}
    verdict = judge_folder(folder(decisions, [*truth, broken]))
    assert verdict["outcome"] == "error"
    assert verdict["error"] == "the model endpoint broke off"
    assert judge_folder(folder(decisions, [BEGIN, END]))["outcome"] == "error"  # a frame without truth
    assert judge_folder(folder([], []))["outcome"] == "error"


def test_a_flight_without_decisions_is_a_failure_only_if_it_has_a_commander_request(folder):
    path = folder([], [BEGIN, pose(0, 16), END])
    assert judge_folder(path)["outcome"] == "error"
    question = {
        "number": 0,
        "t_asked": 0.2,
        "t_answered": None,
        "reply": None,
        "orders": [],
        "confirms": [],
        "causes": [{"why": "start"}],
        "roster": "",
        "frames": [0],
        "model": "m",
    }
    (path / "commander.jsonl").write_text(json.dumps(question) + "\n")
    assert judge_folder(path)["outcome"] == "failure"


def test_a_success_stands_without_an_end_row(folder):
    path = folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 3.0)])
    assert judge_folder(path)["outcome"] == "success"


def test_declarations_of_all_drones_of_a_fleet_count(folder):
    path = folder(
        [decision(0, 0, 5.0, drone=0), decision(0, 1, 5.0, "go", drone=1), decision(1, 3, 9.0, drone=1)],
        [BEGIN, frame(0, 4.5, 30.0, drone=0), frame(1, 4.5, 8.0, drone=1), frame(3, 8.5, 2.0, drone=1), END],
    )
    verdict = judge_folder(path)
    assert verdict["success"]
    assert verdict["deciding"]["drone"] == 1


def test_logs_that_end_at_any_byte_are_judged(folder, tmp_path):
    path = folder(
        [decision(0, 0, 5.0, "go"), decision(1, 1, 9.0)],
        [BEGIN, frame(0, 4.5, 9.0), pose(5.0, 8.0), frame(1, 8.5, 3.0), END],
    )
    for name in ("decisions.jsonl", "truth.jsonl"):
        content = (path / name).read_bytes()
        for cut in range(len(content)):
            (path / name).write_bytes(content[:cut])
            assert judge_folder(path)["outcome"] in ("success", "failure", "error")
        (path / name).write_bytes(content)


def test_damage_in_the_middle_is_reported(folder):
    path = folder([decision(0, 0, 5.0)], [BEGIN, END])
    (path / "truth.jsonl").write_text('{"kind":"begin"\n{"kind":"end"}\n')
    verdict = judge_run(path)["e"]
    assert verdict["outcome"] == "error"
    assert "truth.jsonl line 1" in verdict["error"]


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["action", "t", "x"]), inner),
    max_leaves=4,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["step", "drone", "frame_id", "t_decided", "action"]), JSON,
       st.sampled_from(["kind", "t", "drone", "frame_id", "distance_m", "visible", "reason", "position_ned"]), JSON,
       st.integers(0, 3))  # fmt: skip
def test_any_damage_is_judged_or_reported(folder, key, value, truth_key, truth_value, row):
    decisions = [decision(0, 0, 5.0, "go"), decision(1, 1, 9.0)]
    truth = [BEGIN, frame(0, 4.5, 9.0), pose(5.0, 8.0), END]
    decisions[row % 2][key] = value
    truth[row] = {**truth[row], truth_key: truth_value}
    verdict = judge_run(folder(decisions, truth))["e"]
    assert verdict["outcome"] in ("success", "failure", "error")
    json.dumps(verdict, allow_nan=False)


def test_a_success_stands_if_later_steps_are_unmeasured(folder):
    """Reproduces a real flight: the logger stopped after four good declarations, and the pilot continued."""
    good = [decision(n, n, 10.0 + n) for n in range(4)]
    later = [decision(4, 4, 20.0), decision(5, 5, 23.0, "go")]
    verdict = judge_folder(folder([*good, *later], [BEGIN, *(frame(n, 9.5 + n, 4.0 - n) for n in range(4))]))
    assert (verdict["outcome"], verdict["ne_m"], verdict["note"]) == ("success", 4.0, None)
    assert (verdict["success_at_first"], verdict["declaration_precision"]) == (True, None)


def test_a_success_after_an_unmeasured_declaration_has_a_note(folder):
    path = folder([decision(0, 0, 5.0), decision(1, 1, 9.0)], [BEGIN, frame(1, 8.5, 4.0), END])
    verdict = judge_folder(path)
    assert (verdict["outcome"], verdict["ne_m"], verdict["deciding"]["step"]) == ("success", 4.0, 1)
    assert "step 0 of drone 1" in verdict["note"]
    assert (verdict["success_at_first"], verdict["success_within_three"]) == (None, True)


def test_an_unmeasured_declaration_without_a_success_is_an_error(folder):
    path = folder([decision(0, 0, 5.0), decision(1, 1, 9.0)], [BEGIN, frame(1, 8.5, 6.0), END])
    verdict = judge_folder(path)
    assert (verdict["outcome"], verdict["ne_m"]) == ("error", None)
    assert "frame 0" in verdict["error"]


def test_an_unmeasured_last_action_leaves_only_the_navigation_error_unknown(folder):
    path = folder([decision(0, 0, 5.0), decision(1, 1, 9.0, "go")], [BEGIN, frame(0, 4.5, 6.0), END])
    verdict = judge_folder(path)
    assert (verdict["outcome"], verdict["success"], verdict["ne_m"]) == ("failure", False, None)
    assert "ne_m" in verdict["note"]


def test_fleet_navigation_error_is_unknown_if_a_drone_of_the_last_step_is_unmeasured(folder):
    steps = [decision(0, 0, 5.0, "go"), decision(0, 1, 5.0, "go", drone=1)]
    measured = [frame(0, 4.5, 9.0), frame(1, 4.5, 7.0, drone=1)]
    assert judge_folder(folder(steps, [BEGIN, *measured, END]))["ne_m"] == 7.0
    assert judge_folder(folder(steps, [BEGIN, measured[0], END]))["ne_m"] is None


def test_fleet_navigation_error_is_of_the_closest_last_action_if_drones_have_separate_steps(folder):
    steps = [decision(0, 0, 5.0, "go"), decision(1, 1, 6.0, "go", drone=1), decision(2, 2, 9.0, "go", drone=1)]
    measured = [frame(0, 4.5, 7.0), frame(1, 5.5, 6.0, drone=1), frame(2, 8.5, 9.0, drone=1)]
    assert judge_folder(folder(steps, [BEGIN, *measured, END]))["ne_m"] == 7.0


def test_a_report_is_not_a_declaration_but_its_confirmation_is_one_at_its_own_frame(folder):
    report = decision(0, 0, 5.0, report=True)
    confirmed = {k: v for k, v in decision(1, 1, 9.0, confirmed_by=1).items() if k != "reply"}
    truth = [BEGIN, frame(0, 4.5, 4.0), frame(1, 8.5, 6.0)]
    assert judge_folder(folder([report], [*truth, END]))["declarations"] == 0
    verdict = judge_folder(folder([report, confirmed], [*truth, END]))
    assert (verdict["outcome"], verdict["declarations"], verdict["ne_m"]) == ("failure", 1, 6.0)
    near = [BEGIN, frame(0, 4.5, 6.0), frame(1, 8.5, 4.0), END]
    verdict = judge_folder(folder([report, confirmed], near))
    assert (verdict["outcome"], verdict["deciding"]["step"]) == ("success", 1)


def test_a_flight_that_ended_early_is_censored_at_a_smaller_radius(folder):
    truth = [BEGIN, frame(0, 4.5, 9.0), frame(1, 8.5, 4.0)]
    declared = [decision(0, 0, 5.0), decision(1, 1, 9.0)]
    path = folder(declared, [*truth, DECIDED])
    verdicts = {delta_m: judge_folder(path, delta_m) for delta_m in (3.0, 5.0, 10.0)}
    assert {d: (v["outcome"], v["success"], v["censored"]) for d, v in verdicts.items()} == {
        3.0: ("censored", None, True), 5.0: ("success", True, True), 10.0: ("success", True, True),
    }  # fmt: skip
    assert (verdicts[3.0]["ne_m"], verdicts[3.0]["deciding"], verdicts[3.0]["error"]) == (None, None, None)
    assert (verdicts[3.0]["success_at_first"], verdicts[3.0]["success_within_three"]) == (False, None)
    complete = folder(declared, [*truth, END], "whole")
    assert [(v["outcome"], v["censored"]) for v in (judge_folder(complete, 3.0), judge_folder(complete))] == [
        ("failure", False), ("success", False),
    ]  # fmt: skip


def test_the_current_folder_is_judged_under_its_real_name(folder, monkeypatch):
    monkeypatch.chdir(folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 3.0), END], "here"))
    assert list(judge_run(Path("."))) == ["here"]


def test_the_stored_verdict_is_compared_with_the_derived_one(folder):
    path = folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 3.0), END])
    assert judge_folder(path)["stored_agrees"] is None
    stored = write_verdict(path)
    assert stored == outcome(read(path))
    assert judge_folder(path)["stored_agrees"] is True
    assert judge_folder(path, 4.0)["stored_agrees"] is None
    (path / "verdict.json").write_text(json.dumps({**stored, "ne_m": 1.0}))
    assert judge_folder(path)["stored_agrees"] is False


def test_all_episodes_of_a_run_are_judged_and_a_missing_run_is_an_error(folder, tmp_path):
    folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 3.0), END], "a")
    folder([decision(0, 0, 5.0)], [BEGIN, frame(0, 4.5, 9.0), END], "b")
    assert {k: v["outcome"] for k, v in judge_run(tmp_path).items()} == {"a": "success", "b": "failure"}
    with pytest.raises(UsageError, match="missing"):
        judge_run(tmp_path / "missing")
    with pytest.raises(UsageError, match="empty"):
        judge_run(_empty(tmp_path))


def _empty(tmp_path):
    (tmp_path / "empty").mkdir()
    return tmp_path / "empty"


def test_declarations_after_a_custom_cap_do_not_count():
    flight = logs([decision(0, 0, 199.0), decision(1, 1, 201.0)], [frame(0, 198.5, 9.0), frame(1, 200.5, 3.0)])
    assert (judged_flight.outcome(flight, 5.0, 200.0).outcome, judged_flight.outcome(flight, 5.0, 202.0).outcome) == (
        "failure",
        "success",
    )
    early = judged_flight.outcome(flight, 5.0, 200.0)
    assert (early.ne_m, early.declarations, early.declarations_after_cap, early.cap_s) == (9.0, 1, 1, 200.0)
    assert early.diagnostics is not None
    assert early.diagnostics.min_distance_m == 9.0
    assert "cap_s" not in judged_flight.outcome(flight).as_json()


def test_a_flight_decided_after_a_shorter_cap_is_not_censored_at_that_cap():
    rows = [decision(0, 0, 199.0), decision(1, 1, 201.0)], [frame(0, 198.5, 9.0), frame(1, 200.5, 3.0)]
    decided = logs(*rows, end={**END, "reason": "decided", "t": 201.5})
    assert judged_flight.outcome(decided).outcome == "success"
    assert judged_flight.outcome(decided, 5.0, 200.0).outcome == "failure"
    assert not judged_flight.outcome(decided, 5.0, 200.0).censored
    assert judged_flight.outcome(decided, 2.0).outcome == "censored"
    assert judged_flight.outcome(decided, 2.0, 200.0).outcome == "failure"
    to_its_cap = logs(*rows, end={**END, "t": 300.0})
    assert [judged_flight.outcome(to_its_cap, 2.0, cap_s).outcome for cap_s in (200.0, 300.0, 600.0)] == [
        "failure", "failure", "censored",
    ]  # fmt: skip


@pytest.mark.parametrize("reason", ["interrupted", "takeover", "error"])
def test_a_flight_that_ended_abnormally_after_a_shorter_cap_is_a_failure_at_that_cap(reason):
    rows = [decision(0, 0, 199.0, "go"), decision(1, 1, 301.0, "go")], [frame(0, 198.5, 9.0), frame(1, 300.5, 9.0)]
    broken = logs(*rows, begin={**BEGIN, "cap_s": 600.0}, end={**END, "reason": reason, "t": 450.0})
    assert [judged_flight.outcome(broken, 5.0, cap_s).outcome for cap_s in (200.0, 300.0, 400.0, 600.0)] == [
        "failure", "failure", "error", "error",
    ]  # fmt: skip
    assert not judged_flight.outcome(broken, 5.0, 300.0).censored


def test_a_flight_that_waited_beyond_its_own_cap_for_a_reply_that_never_came_is_an_error():
    dead = {**END, "reason": "error", "t": 330.0, "error": "the model has not answered"}
    verdict = judged_flight.outcome(logs([decision(0, 0, 199.0, "go")], [frame(0, 198.5, 9.0)], end=dead))
    assert (verdict.outcome, verdict.error) == ("error", "the model has not answered")
