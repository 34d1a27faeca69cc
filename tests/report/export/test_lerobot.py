"""Tests LeRobot datasets: the values agree with the logs, and LeRobot's own class opens them if installed.

DRONECATS_LEROBOT_PYTHON names an interpreter with LeRobot, which needs PyTorch and other package versions.
"""

import json
import math
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from dronecats.report.export import lerobot
from dronecats.report.export.formats import finished_flight
from dronecats.report.export.lerobot import (
    ACTION,
    BODY_VELOCITY,
    STATE,
    body_velocity,
    four_action,
    merged,
    moments,
    state,
)
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_yaw
from foundation.mavlink import dialect
from foundation.run_folder.rows import Decision
from tests.needs import needs
from tests.report.export.conftest import ALONE
from tests.support.logged_messages import logged_messages

PYTHON = os.environ.get("DRONECATS_LEROBOT_PYTHON")


@pytest.fixture(scope="module")
def dataset(alone, fleet, tmp_path_factory):
    """Return (folder, [(flight, drone, its decisions)] of each episode)."""
    out = tmp_path_factory.mktemp("lerobot") / "flown"
    left_out: list[str] = []
    frames = lerobot.write(iter([alone, fleet]), out, False, left_out)
    parts = [
        (flight, drone, [s.decision for s in flight.steps if s.decision.drone == drone.number])
        for flight in (alone, fleet)
        for drone in flight.drone_tracks
    ]
    assert left_out == []
    assert frames == sum(len(decisions) for _, _, decisions in parts)
    return out, parts


def rows(out):
    return pq.read_table(out / "data" / "chunk-000" / "file-000.parquet").to_pylist()


def test_every_decision_is_a_frame_with_the_pilots_own_picture(dataset):
    out, parts = dataset
    table_rows = iter(rows(out))
    index = 0
    for episode, (flight, drone, decisions) in enumerate(parts):
        for k, decision in enumerate(decisions):
            row = next(table_rows)
            jpeg = next(f.jpeg for f in flight.frames if (f.drone, f.frame_id) == (drone.number, decision.frame_id))
            assert row["observation.images.front"]["bytes"] == jpeg.read_bytes()
            assert (row["episode_index"], row["frame_index"], row["index"]) == (episode, k, index)
            assert row["time.frame_s"] == pytest.approx(decision.t_frame, abs=1e-5)
            assert row["next.done"] is (k == len(decisions) - 1)
            assert row["judge.success"] is flight.verdict.success
            index += 1
    assert next(table_rows, None) is None


def autopilot_positions(flight, number, decisions):
    """Return the newest LOCAL_POSITION_NED at each image, relative to the one at the first image: (n, 3)."""
    kind = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    sent = [m for m in logged_messages(flight.folder / "flight.tlog", {kind}) if m.get_srcSystem() == number + 1]
    at_ms = [(flight.t0_us + round(d.t_frame * 1e6)) // 1000 for d in decisions]
    newest = [max((m for m in sent if m.time_boot_ms <= at), key=lambda m: m.time_boot_ms) for at in at_ms]
    places = np.array([(m.x, m.y, m.z) for m in newest])
    return places - places[0]


def test_the_state_is_the_autopilots_estimate_and_not_the_truth(dataset):
    out, parts = dataset
    states = np.array([row["observation.state"] for row in rows(out)], np.float64)
    at = 0
    for flight, drone, decisions in parts:
        true = np.array([drone.truth.position_ned[drone.truth.newest(d.t_frame)] for d in decisions])
        place = states[at : at + len(decisions), :3]
        np.testing.assert_allclose(place, autopilot_positions(flight, drone.number, decisions), atol=1e-4)
        assert np.abs(place - (true - true[0]))[:, :2].max() < 2.5
        assert (place[0] == 0.0).all()
        for decision, numbers in zip(decisions, states[at:], strict=False):
            heading = quat_yaw(tuple(drone.truth.attitude[drone.truth.newest(decision.t_frame)]))
            assert abs((numbers[8] - heading + math.pi) % (2 * math.pi) - math.pi) < math.radians(15.0)
            velocity = drone.truth.velocity_ned[drone.truth.newest(decision.t_frame)]
            forward = velocity[0] * math.cos(heading) + velocity[1] * math.sin(heading)
            assert numbers[3] == pytest.approx(forward, abs=0.6)
        at += len(decisions)


def test_velocity_is_in_the_heading_frame(alone):
    track = alone.drone_tracks[0].estimate
    fastest = int(np.argmax(np.linalg.norm(track.velocity_ned[:, :2], axis=1)))
    numbers = state(track, float(track.t_s[fastest]), float(track.t_s[0]))
    north, east, down = track.velocity_ned[fastest]
    yaw = numbers[8]
    np.testing.assert_allclose(
        complex(numbers[3], numbers[4]) * complex(math.cos(yaw), math.sin(yaw)), complex(north, east), atol=1e-5
    )
    assert numbers[5] == pytest.approx(down, abs=1e-6)


def decision_with(action):
    return Decision(step=0, drone=0, frame_id=0, t_frame=0.0, t_decided=0.0, action=action)


def test_actions_are_encoded_in_the_four_action_form():
    for action, expected in (
        ({"action": "go", "point": [250.0, 400.0], "depth_m": 6.5}, (1, 0, 0, 0, 250, 400, 6.5, 0)),
        ({"action": "rotate", "angle_deg": -30.0}, (0, 1, 0, 0, 0, 0, 0, -30)),
        ({"action": "think"}, (0, 0, 1, 0, 0, 0, 0, 0)),
        ({"action": "finished"}, (0, 0, 0, 1, 0, 0, 0, 0)),
        (None, (0,) * 8),
    ):
        np.testing.assert_allclose(four_action(decision_with(action)), np.array(expected, np.float32))
        assert len(ACTION) == 8


def test_a_body_velocity_leads_to_the_end_of_the_action():
    """Calculated by hand: a far point 45° to the right is a turn of 45° at 60°/s, then 3 m along that line."""
    forward, right, down, rate, seconds = body_velocity(
        decision_with({"action": "go", "point": [1000.0, 500.0], "depth_m": 20.0}), CameraModel()
    )
    assert seconds == pytest.approx(2.5 + 0.75, abs=1e-5)
    assert (forward * seconds, right * seconds) == pytest.approx((3 * math.sqrt(0.5),) * 2, abs=1e-5)
    assert down == 0.0
    assert rate * seconds == pytest.approx(math.pi / 4, abs=1e-5)


def test_a_point_above_gives_a_climbing_velocity():
    forward, right, down, rate, seconds = body_velocity(
        decision_with({"action": "go", "point": [500.0, 0.0], "depth_m": 20.0}), CameraModel()
    )
    assert (right, rate) == (0.0, 0.0)
    assert math.hypot(forward, down) * seconds == pytest.approx(3.0, abs=1e-5)
    assert down / forward == pytest.approx(-360.0 / 640.0, abs=1e-5)


def test_a_rotation_turns_in_place_and_other_actions_hold():
    np.testing.assert_allclose(
        body_velocity(decision_with({"action": "rotate", "angle_deg": -60.0}), CameraModel()),
        (0.0, 0.0, 0.0, -math.pi / 3, 1.0), atol=1e-6,
    )  # fmt: skip
    for action in ({"action": "think"}, {"action": "finished"}, None):
        np.testing.assert_allclose(body_velocity(decision_with(action), CameraModel()), (0.0, 0.0, 0.0, 0.0, 2.5))


def test_merged_moments_of_parts_equal_the_moments_of_all_values():
    values = np.random.default_rng(1).normal(3.0, 2.0, (40, 3))
    total, parts = moments(values), merged([moments(values[:7]), moments(values[7:9]), moments(values[9:])])
    for key, value in total.as_lists().items():
        np.testing.assert_allclose(parts.as_lists()[key], value, rtol=1e-12)


def test_flights_without_images_are_reported(run, alone, tmp_path):
    shutil.copytree(run.folder / ALONE, tmp_path / ALONE)
    shutil.rmtree(tmp_path / ALONE / "frames")
    left_out: list[str] = []
    blind = finished_flight(tmp_path / ALONE)
    assert lerobot.write(iter([blind, alone]), tmp_path / "out", False, left_out) == len(alone.steps)
    (left,) = left_out
    assert ALONE in left
    with pytest.raises(UsageError, match=left):
        lerobot.write(iter([blind]), tmp_path / "other", False, [])
    assert not (tmp_path / "other").exists()


def rewrite(log, change):
    rows = [change(json.loads(line)) for line in log.read_text().splitlines()]
    log.write_text("".join(json.dumps(row) + "\n" for row in rows))


def test_flights_with_a_damaged_picture_or_without_a_score_are_reported(run, alone, tmp_path):
    damaged, broken_off = (tmp_path / name / ALONE for name in ("damaged", "broken-off"))
    for folder in (damaged, broken_off):
        shutil.copytree(run.folder / ALONE, folder)
    next((damaged / "frames").iterdir()).write_bytes(b"")
    think = {"reply": '{"action": "think"}', "action": {"action": "think"}}
    rewrite(broken_off / "decisions.jsonl", lambda row: row | think)  # no declaration
    rewrite(broken_off / "truth.jsonl", lambda row: row | ({"reason": "error"} if row["kind"] == "end" else {}))
    left_out: list[str] = []
    flights = [finished_flight(damaged), finished_flight(broken_off), alone]
    assert lerobot.write(iter(flights), tmp_path / "out", False, left_out) == len(alone.steps)
    assert len(left_out) == 2
    assert "damaged" in left_out[0]
    assert "not scored" in left_out[1]


def test_other_files_are_never_overwritten(alone, tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UsageError, match="--overwrite"):
        lerobot.write(iter([alone]), tmp_path, False, [])
    with pytest.raises(UsageError, match=str(tmp_path)):
        lerobot.write(iter([alone]), tmp_path, True, [])
    assert (tmp_path / "thesis.txt").read_text() == "mine"


@needs("lerobot")
def test_lerobots_own_class_reads_the_same_values(dataset):
    out, parts = dataset
    reader = Path(__file__).with_name("lerobot_reader.py")
    done = subprocess.run(
        [str(PYTHON), str(reader), str(out)],
        env={**os.environ, "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    summary = json.loads(done.stdout.splitlines()[-1])
    table = rows(out)
    assert summary["frames"] == len(table)
    assert summary["lengths"] == [len(decisions) for _, _, decisions in parts]
    whose = [(flight, drone, decision) for flight, drone, decisions in parts for decision in decisions]
    last = [decision is decisions[-1] for _, _, decisions in parts for decision in decisions]
    for k, (item, row, (flight, drone, decision)) in enumerate(zip(summary["items"], table, whose, strict=True)):
        assert item["task"] == flight.instruction
        assert len(item["observation.state"]) == len(STATE)
        assert len(item["action.body_velocity"]) == len(BODY_VELOCITY)
        np.testing.assert_allclose(item["observation.state"], row["observation.state"], rtol=1e-6)
        np.testing.assert_allclose(item["action"][0], four_action(decision), rtol=1e-6)
        following = whose[k if last[k] else k + 1][2]
        np.testing.assert_allclose(item["action"][1], four_action(following), rtol=1e-6)
        assert item["timestamp"] == row["frame_index"]
        assert item["judge.success"] is flight.verdict.success
        jpeg = next(f.jpeg for f in flight.frames if (f.drone, f.frame_id) == (drone.number, decision.frame_id))
        picture: Any = cv2.imread(str(jpeg), cv2.IMREAD_COLOR_RGB)
        assert item["shape"] == [3, *picture.shape[:2]]
        np.testing.assert_allclose(item["colour"], picture.mean(axis=(0, 1)) / 255.0, atol=2e-3)
    actions = np.array([four_action(decision) for _, _, decision in whose], np.float64)
    np.testing.assert_allclose(summary["stats"]["action"]["mean"], actions.mean(0), rtol=1e-5)
    np.testing.assert_allclose(summary["stats"]["action"]["std"], actions.std(0), rtol=1e-5, atol=1e-9)
    assert summary["stats"]["observation.images.front"]["mean"][0][0][0] == pytest.approx(
        np.mean([item["colour"][0] for item in summary["items"]]), abs=0.02
    )
