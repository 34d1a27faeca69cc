"""Tests that contradictory logs are not scored, unless a success is certain."""

import json

import pytest

from dronecats.judge.episode import folder_contradictions, log_contradictions, reply_contradictions
from tests.judge.episode_logs import BEGIN, DECIDED, END, decision, frame, judge_folder, logs, outcome, pose, write

GO = [decision(0, 0, 5.0, "go")]
SEEN = [pose(0.0, 12.0), frame(0, 4.5, 9.0)]


def judge_logs(decisions, truth, **more):
    verdict = outcome(logs(decisions, truth, **more))
    return verdict["outcome"], verdict["error"]


def test_a_decided_end_without_a_qualifying_declaration_is_an_error():
    for decisions in ([], GO, [decision(0, 0, 5.0)]):  # no decision, no declaration, one that does not qualify
        named, error = judge_logs(decisions, SEEN, end=DECIDED)
        assert named == "error", decisions
        assert "decisions.jsonl" in error, decisions
    assert judge_logs([decision(0, 0, 5.0)], [frame(0, 4.5, 4.0)], end=DECIDED)[0] == "success"


def test_an_end_with_reason_cap_long_before_the_cap_is_an_error():
    for cap_s, end_s, good in (
        (None, 300.0, True), (None, 295.0, True), (None, 294.9, False), (45.0, 45.1, True), (45.0, 39.9, False),
    ):  # fmt: skip
        named, error = judge_logs(GO, SEEN, begin={**BEGIN, "cap_s": cap_s}, end={**END, "t": end_s})
        assert named == ("failure" if good else "error"), (cap_s, end_s)
        assert good or f"{end_s:g} s" in error, (cap_s, end_s)


def test_a_flight_to_the_cap_without_decisions_or_measurements_is_an_error():
    assert "decisions.jsonl" in judge_logs([], SEEN)[1]
    assert "logger" in judge_logs(GO, [pose(0.0, None, None)])[1]


def test_a_missing_or_duplicate_step_is_an_error():
    truth = [*SEEN, frame(1, 8.5, 9.0), frame(2, 11.5, 9.0)]
    for decisions, place in (
        ([*GO, decision(2, 2, 12.0, "go")], "step 1"),
        ([decision(1, 1, 9.0, "go")], "step 0"),
        ([*GO, *GO], "step 0 of drone 1"),
    ):
        named, error = judge_logs(decisions, truth)
        assert named == "error", place
        assert place in error


def test_a_contradiction_cannot_undo_a_success():
    truth = [*SEEN, frame(2, 8.5, 4.0)]
    for end in (None, {**END, "t": 20.0}, {**END, "reason": "error"}):
        assert judge_logs([*GO, decision(2, 2, 9.0)], truth, end=end) == ("success", None)


POSITIONS = {"position_ned": [0.0, 0.0, -2.0], "target_ned": [3.0, 0.0, 2.0]}  # 5 m apart


@pytest.mark.parametrize(
    "doubtful",
    [
        frame(1, 8.6, 4.0),  # its time differs from the decision's frame time
        frame(1, 8.5, 4.0, **POSITIONS),  # its distance is less than that of its positions
    ],
)
def test_a_declaration_with_a_contradictory_measurement_is_unmeasured(doubtful):
    flight = logs([*GO, decision(1, 1, 9.0)], [*SEEN, doubtful])
    assert outcome(flight)["outcome"] == "error"
    assert len(log_contradictions(flight)) == 1
    good = logs([*GO, decision(1, 1, 9.0)], [*SEEN, frame(1, 8.5, 5.0002, **POSITIONS)])
    assert outcome(good, 5.001)["outcome"] == "success"
    assert log_contradictions(good) == []


def test_the_distance_of_a_pose_must_match_its_positions():
    here = pose(1.0, 5.0, place=[0.0, 0.0, -2.0], target_ned=[3.0, 0.0, 2.0])
    assert log_contradictions(logs(GO, [*SEEN, here])) == []
    assert len(log_contradictions(logs(GO, [*SEEN, {**here, "distance_m": 5.01}]))) == 1


def replied(reply, action, drone=0):
    return {**decision(0, drone, 5.0, drone=drone), "reply": reply, "action": action}


def test_the_logged_action_must_match_the_reply():
    go = {"action": "go", "point": [100.0, 900.0], "depth_m": 4.0}
    consistent = [
        replied('{"action": "finished"}', {"action": "finished"}),
        replied('so: {"action": "go", "point": [100, 900], "depth_m": 4}', go),
        replied('{"action": "go", "point": [900, 100], "depth_m": 4}', go),  # from a model that gives y first
        replied("I cannot", None),
    ]
    for row in consistent:
        assert reply_contradictions(logs([row])) == []
        other = {**row, "action": {"action": "think"}}
        assert len(reply_contradictions(logs([other]))) == 1
    assert len(reply_contradictions(logs([replied("I cannot", {"action": "finished"})]))) == 1


def test_each_drone_of_a_fleet_must_have_its_own_action_of_the_reply():
    reply = '[{"action": "think"}, {"action": "finished"}]'
    fleet = [replied(reply, {"action": "think"}), replied(reply, {"action": "finished"}, 1)]
    assert reply_contradictions(logs(fleet)) == []
    swapped = [replied(reply, {"action": "finished"}), replied(reply, {"action": "think"}, 1)]
    assert len(reply_contradictions(logs(swapped))) == 1


def test_a_repaired_reply_is_parsed_again_with_the_same_repairs():
    reply = "[{'drone': 2, 'action': 'think'}, {'drone': 1, 'action': 'finished'}]"
    fleet = [replied(reply, {"action": "finished"}), replied(reply, {"action": "think"}, 1)]
    mended = [{**row, "mended": ["single_quotes", "by_name"]} for row in fleet]
    assert reply_contradictions(logs(mended)) == []
    assert len(reply_contradictions(logs(fleet))) == 1  # these rows record no repair
    swapped = [{**row, "action": other["action"]} for row, other in zip(mended, reversed(fleet), strict=True)]
    assert len(reply_contradictions(logs(swapped))) == 1


def test_drones_with_separate_requests_have_their_own_replies():
    """A commander's confirmation has no reply. The drone's own replies are parsed as replies for one drone."""
    rows = [{**replied('{"action": "think"}', {"action": "think"}, drone), "step": drone} for drone in range(3)]
    confirmed = {k: v for k, v in decision(3, 1, 6.0, drone=1).items() if k != "reply"}
    assert reply_contradictions(logs([*rows, {**confirmed, "confirmed_by": 0}])) == []
    other = {**rows[2], "action": {"action": "finished"}}
    assert len(reply_contradictions(logs([*rows[:2], other]))) == 1


def test_a_fleet_step_cut_to_one_row_is_still_parsed_as_a_fleet_step():
    reply = '[{"action": "think"}, {"action": "finished"}]'
    complete = [replied(reply, {"action": "think"}), replied(reply, {"action": "finished"}, 1)]
    assert reply_contradictions(logs([*complete, {**complete[0], "step": 1}])) == []


def test_confirmed_declarations_must_match_the_commander_log_and_its_damage_is_only_reported(tmp_path):
    confirmed = {k: v for k, v in decision(0, 7, 5.0, drone=1, confirmed_by=2).items() if k != "reply"}
    folder = write(tmp_path / "a-01", [confirmed], [BEGIN, frame(7, 4.5, 4.0, drone=1), END])
    (missing,) = judge_folder(folder)["contradictions"]
    assert "step 0" in missing
    assert "commander.jsonl" in missing
    exchange = {"number": 2, "t_asked": 4.5, "t_answered": 5.0, "causes": [{"why": "report", "drone": 1}], "roster": "",
                "frames": [6, 7], "reply": "{}", "orders": [], "confirms": [1], "model": "m"}  # fmt: skip
    for change, contradictions in (({}, []), ({"confirms": [0]}, [missing]), ({"frames": [7, 6]}, [missing])):
        (folder / "commander.jsonl").write_text(json.dumps({**exchange, **change}) + "\n")
        assert judge_folder(folder)["contradictions"] == contradictions
    (folder / "commander.jsonl").write_text('{"number": -1}\n{}\n')
    judged = judge_folder(folder)
    assert judged["outcome"] == "success"
    assert "commander.jsonl line 1" in judged["contradictions"][0]


def test_an_episode_in_a_folder_of_another_name_is_a_contradiction(tmp_path):
    folder = write(tmp_path / "a-01", GO, [BEGIN, *SEEN, END])
    (folder / "episode.json").write_text('{"id": "b-02"}')
    assert judge_folder(folder)["contradictions"] == folder_contradictions("a-01", {"id": "b-02"})
    (folder / "episode.json").write_text('{"id": "a-01"}')
    assert judge_folder(folder)["contradictions"] == []
