"""Flights with deliberately late, stale or rare pictures, checked against the logs, the truth and the clock."""

import itertools
import json
import math
from dataclasses import replace

import pytest

from dronecats.agent.models.replay import FlightRecording, LoggedReply
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.disturbances import Disturbances, FrameFaults
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.frames import wrap_pi
from tests.support.json_lines import rows

EPISODE = "residential-approaching-03"
LATENCY_S = 0.5
LOGS = ("truth.jsonl", "decisions.jsonl", "verdict.json")
UNSEEN = FlightSpec(
    pilot="blind:straight", episode=EPISODE, simulated=Simulated(speed=None, rendered=False), seconds=18.0, full=True
)
TICK_S = 0.05


def fly_with_faults(folder, spec=UNSEEN, **faults):
    """Fly, and return the episode's folder."""
    spec = replace(spec, disturbances=Disturbances(frame=FrameFaults(**faults)))
    result = fly(spec, folder, lambda line: None)
    assert result["reason"] == "cap", result["error"]
    return next(path.parent for path in folder.rglob("truth.jsonl"))


def ages(folder, latency_s=LATENCY_S):
    """Return the age (s) of each decision's picture at its question, from the decisions' own times."""
    return [decision["t_decided"] - latency_s - decision["t_frame"] for decision in rows(folder / "decisions.jsonl")]


def test_without_frame_faults_pictures_are_current_and_no_disturbance_is_recorded(tmp_path):
    assert FrameFaults(dropped=0.0, stale=0.0) == FrameFaults()
    plain = fly_with_faults(tmp_path / "plain")
    assert ages(plain) == pytest.approx([0.0] * len(ages(plain)), abs=1e-6)
    assert "disturbed" not in json.loads((plain.parent / "run.json").read_text())


def test_a_late_picture_is_used_after_its_delay_and_measured_at_its_shutter_time(tmp_path):
    folder = fly_with_faults(tmp_path / "run", delay_s=1.2)
    late = ages(folder)
    assert len(late) >= 4
    assert late == pytest.approx([1.2] * len(late), abs=TICK_S + 1e-6)
    taken = {row["frame_id"]: row["t"] for row in rows(folder / "truth.jsonl", "frame")}
    assert [taken[decision["frame_id"]] for decision in rows(folder / "decisions.jsonl")] == [
        decision["t_frame"] for decision in rows(folder / "decisions.jsonl")
    ]
    run = json.loads((folder.parent / "run.json").read_text())
    assert "1.2 s" in run["disturbed"]
    assert run["flight"]["disturbances"]["frame"]["delay_s"] == 1.2
    again = fly_with_faults(tmp_path / "again", delay_s=1.2)
    assert all((folder / name).read_bytes() == (again / name).read_bytes() for name in LOGS)


TURN, GO = {"action": "rotate", "angle_deg": 60}, {"action": "go", "point": [500, 500], "depth_m": 20}


TURNING = FlightRecording(
    flight="made up",
    to_the_cap=True,
    steps=tuple(LoggedReply(step=step, drone=0, reply=json.dumps((TURN, GO)[step % 2])) for step in range(60)),
)


@pytest.mark.parametrize(
    "faults", [{"rate_hz": 2.0, "delay_s": 2.0}, {"stale": 0.6}, {"delay_s": 1.0}], ids=["rate", "stale", "delay"]
)
def test_a_go_follows_the_ray_of_its_picture_even_if_the_heading_has_changed(tmp_path, faults):
    spec = replace(UNSEEN, replay=TURNING, seconds=60.0, seed=3)
    folder = fly_with_faults(tmp_path / "run", spec, **faults)
    truth = rows(folder / "truth.jsonl")
    frames = {row["frame_id"]: row for row in truth if row["kind"] == "frame"}
    poses = [row for row in truth if row["kind"] == "pose"]
    across, apart = [], []
    for before, after in itertools.pairwise(rows(folder / "decisions.jsonl")):
        if before["action"]["action"] != "go":
            continue
        picture = frames[before["frame_id"]]
        begin = min(poses, key=lambda row: abs(row["t"] - before["t_decided"]))
        end = max((row for row in poses if row["t"] <= after["t_decided"]), key=lambda row: row["t"])
        yaw = math.radians(picture["yaw_deg"])
        north, east = (end["position_ned"][i] - picture["position_ned"][i] for i in (0, 1))
        across.append(abs(-math.sin(yaw) * north + math.cos(yaw) * east))
        apart.append(abs(wrap_pi(math.radians(begin["yaw_deg"]) - yaw)))
    assert len(across) >= 5
    assert max(across) < 0.25
    if "delay_s" not in faults or "rate_hz" in faults:
        assert sum(each > math.radians(45.0) for each in apart) >= 3  # the heading had changed, which had no effect


@pytest.mark.slow
def test_the_oracle_gets_the_truth_at_the_time_of_the_picture(tmp_path):
    """So each of its goes points at the target in its own picture, even if the picture is late."""
    for name, faults in (("rate", {"rate_hz": 1.0, "delay_s": 2.0}), ("stale", {"stale": 0.6})):
        folder = fly_with_faults(tmp_path / name, replace(UNSEEN, pilot="oracle", seconds=40.0), **faults)
        frames = {row["frame_id"]: row for row in rows(folder / "truth.jsonl", "frame")}
        gone = [
            decision
            for decision in rows(folder / "decisions.jsonl")
            if decision["action"]["action"] == "go"
            and frames[decision["frame_id"]]["distance_m"] > 5.0  # the vehicle backs away when it is nearer
        ]
        assert len(gone) >= 4
        for decision in gone:
            bearing = math.degrees(math.atan(decision["action"]["point"][0] / 500.0 - 1.0))
            assert bearing == pytest.approx(frames[decision["frame_id"]]["bearing_deg"], abs=1.5)


@pytest.mark.slow("flies in real time, twice")
def test_frame_faults_hit_the_same_questions_in_real_time(tmp_path):
    """The same questions get a stale picture as in lockstep. The time that a picture takes depends on the host."""
    there = replace(UNSEEN, simulated=Simulated(speed=2.0), seconds=36.0)  # a busy host needs longer for three steps
    late = fly_with_faults(tmp_path / "late", there, delay_s=2.5)
    for age, decision in zip(ages(late), rows(late / "decisions.jsonl"), strict=True):
        assert 2.5 - 1e-6 <= age < 4.0 + decision["host_lag_s"] + decision["frame_wait_s"]
    truth = {row["frame_id"]: row["t"] for row in rows(late / "truth.jsonl", "frame")}
    assert all(truth[decision["frame_id"]] == decision["t_frame"] for decision in rows(late / "decisions.jsonl"))
    stale = [
        [
            decision["frame_id"] == before["frame_id"]
            for before, decision in itertools.pairwise(rows(folder / "decisions.jsonl"))
        ]
        for folder in (
            fly_with_faults(tmp_path / "real", there, stale=0.5),
            fly_with_faults(tmp_path / "step", stale=0.5),
        )
    ]
    steps = min(map(len, stale))
    assert steps >= 3
    assert stale[0][:steps] == stale[1][:steps]
    assert any(stale[1])
    often = fly_with_faults(tmp_path / "rate", there, rate_hz=2.0, delay_s=1.5)
    taken = [decision["t_frame"] % 0.5 for decision in rows(often / "decisions.jsonl")]
    assert all(each <= 0.02 + 1e-6 for each in taken)  # up to one period of the truth (50 Hz) after the shutter
