"""Four drones share one model context: one request with four pictures, one array of four actions, one verdict."""

from typing import Any

import pytest

from tests.support.flight import fly_beginning, fly_simulated
from tests.support.json_lines import rows
from tests.system.fleet_pictures import check


def fly(capsys, out, *arguments):
    result, folder = fly_simulated(capsys, out, "--pilot", "oracle", *arguments)
    logs = ("decisions.jsonl", "truth.jsonl")
    return result, *(rows(folder / log) for log in logs)


@pytest.mark.parametrize(
    "episode", ["blocks-commanding-01", pytest.param("residential-commanding-01", marks=pytest.mark.slow)]
)
def test_a_fleet_finds_the_named_candidate_in_lockstep(tmp_path, capsys, episode):
    result, decisions, truth = fly(capsys, tmp_path / "run", "--speed", "max", "--episode", episode)
    assert result["success"]
    steps: dict[int, list[Any]] = {}
    for decision in decisions:
        steps.setdefault(decision["step"], []).append(decision)
    for together in steps.values():
        assert [d["drone"] for d in together] == [0, 1, 2, 3]
        assert len({d["reply"] for d in together}) == 1  # one context: the same text, with a part for each drone
        assert len({d["frame_id"] for d in together}) == 4
    frames = {f["frame_id"]: f for f in truth if f["kind"] == "frame"}
    assert all(frames[d["frame_id"]]["drone"] == d["drone"] for d in decisions)
    claims = [d for d in decisions if d["action"]["action"] == "finished"]
    assert len(claims) == result["declarations"] == 1
    assert frames[claims[0]["frame_id"]]["distance_m"] == pytest.approx(result["ne_m"], abs=1e-3)
    poses = [p for p in truth if p["kind"] == "pose"]
    assert {p["drone"] for p in poses} == {0, 1, 2, 3}
    waiting = set(range(4)) - {claims[0]["drone"]}
    for drone in waiting:  # hovering drones stay at their start
        places = [p["position_ned"] for p in poses if p["drone"] == drone]
        assert max(abs(a - b) for place in places for a, b in zip(place, places[0], strict=True)) < 0.8
    seen, empty = check(tmp_path / "run" / episode, truth)
    assert seen >= 2  # drones that those behind see
    assert empty >= 2  # pictures of the drones in front


@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_each_decision_of_a_fleet_follows_its_picture_by_the_latency(tmp_path, seconds):
    words = ("--pilot", "oracle", "--episode", "blocks-commanding-02", "--latency", f"fixed:{seconds:g}")
    folder = fly_beginning(tmp_path / "run", 8.0, *words)
    decisions, truth = rows(folder / "decisions.jsonl"), rows(folder / "truth.jsonl")
    assert len({decision["step"] for decision in decisions}) >= 2
    taken = {f["frame_id"]: f["t"] for f in truth if f["kind"] == "frame"}
    for decision in decisions:
        assert decision["t_frame"] == pytest.approx(taken[decision["frame_id"]], abs=1e-6)
        assert decision["t_decided"] >= decision["t_frame"] + seconds - 1e-6
        assert decision["t_decided"] <= decision["t_frame"] + seconds + 0.15


@pytest.mark.slow("flies a fleet in real time")
def test_a_fleet_succeeds_in_real_time(tmp_path, capsys):
    result, decisions, truth = fly(capsys, tmp_path / "run", "--speed", "1", "--episode", "blocks-commanding-01")
    assert result["success"]
    seen, _ = check(tmp_path / "run" / "blocks-commanding-01", truth)
    assert seen >= 1  # in the first pictures; later positions depend on the machine
    assert {d["drone"] for d in decisions} == {0, 1, 2, 3}
