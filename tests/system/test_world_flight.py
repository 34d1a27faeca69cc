"""`fly --connect --world --truth`: an external simulated vehicle flies our episodes and is judged.

Here the vehicle is our own simulator on another map, with a distant position and another heading.
A real PX4 gave the same results.
"""

import json
import math
import subprocess

import pytest

from dronecats.cli.main import main
from dronecats.flight.sitl.episode_world import load_world
from foundation.run_folder.reading import read
from tests.support.command_line import DRONECATS, last_object
from tests.support.simulated_vehicle import patient_state, simulated_vehicle

HERE = "campus-approaching-01"


@pytest.fixture
def elsewhere(tmp_path):
    """Yield the link URL and the truth URL of a vehicle that is simulated on another map."""
    with simulated_vehicle(tmp_path, state_dir=patient_state(tmp_path)) as ports:
        yield f"udpout://127.0.0.1:{ports['agent'][0]}", f"udpout://127.0.0.1:{ports['truth']}"


def fly(out, *arguments, typed="ARM\n"):
    command = [*DRONECATS, "fly", *arguments, "--out", str(out), "--json"]
    done = subprocess.run(command, input=typed, capture_output=True, text=True, timeout=300, check=False)
    return done, last_object(done.stdout) if done.returncode == 0 else None


@pytest.mark.slow("flies in real time")
def test_an_external_vehicle_flies_an_episode_and_is_judged(elsewhere, tmp_path):
    link, truth = elsewhere
    done, result = fly(
        tmp_path / "run", "--connect", link, "--truth", truth, "--world", HERE, "--pilot", "oracle", "--arm"
    )
    assert done.returncode == 0, done.stderr
    assert result["outcome"] == "success"
    assert result["episode"] == HERE
    folder = tmp_path / "run" / HERE
    start = load_world(HERE).record.starts[0]
    logs = read(folder)
    assert math.dist(logs.poses[0].position_ned, start.position_ned) < 1.0
    assert logs.poses[0].yaw_deg is not None
    assert abs((logs.poses[0].yaw_deg - start.yaw_deg + 180.0) % 360.0 - 180.0) < 5.0
    assert {(decision.drone, decision.frame_id) for decision in logs.decisions} <= set(logs.frames)
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    connected = run["flight"]["connected"]
    assert (connected["url"], connected["truth"], run["camera"]["width"]) == (link, truth, 1280)
    assert (folder / "flight.tlog").stat().st_size > 10_000
    judged = subprocess.run(
        [*DRONECATS, "judge", str(tmp_path / "run"), "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert judged.returncode == 0, judged.stderr


@pytest.mark.slow("flies in real time")
def test_a_flight_on_a_map_without_an_episode_has_no_verdict(elsewhere, tmp_path):
    link, truth = elsewhere
    done, result = fly(
        tmp_path / "run", "--connect", link, "--truth", truth, "--world", "blocks", "--instruction",
        "go to the red box", "--pilot", "blind", "--arm", "--seconds", "8",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert result["success"] is None
    folder = tmp_path / "run" / "free-blocks"
    assert list((folder / "frames").glob("*.jpg"))
    assert json.loads((folder / "episode.json").read_text()) == {
        "id": "free-blocks",
        "instruction": "go to the red box",
    }


def test_invalid_world_flights_are_rejected_before_any_file_is_written(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("dronecats.flight.sitl.truth_bridge.SILENT_S", 0.3)  # the last case waits for truth data
    for arguments, part in (
        (["--world", HERE], "--truth"),
        (["--truth", "udpin://127.0.0.1:0"], "--world"),
        (["--world", HERE, "--truth", "x", "--camera", "v4l2:0"], "--camera"),
        (["--world", HERE, "--truth", "x"], "'x'"),
        (["--world", HERE, "--truth", "udpin://127.0.0.1:0", "--instruction", "go"], "instruction"),
        (["--world", "campus", "--truth", "udpin://127.0.0.1:0"], "--instruction"),
        (["--world", "campus", "--truth", "x", "--instruction", "go", "--pilot", "oracle"], "oracle"),
        (["--world", "no-such-place", "--truth", "x"], "no-such-place"),
        (["--world", HERE, "--truth", "udpin://127.0.0.1:0"], "--truth"),
    ):
        words = ["fly", "--connect", "udpin://127.0.0.1:0", *arguments, "--out", str(tmp_path / "run")]
        assert main(words) == 2, arguments
        assert part in capsys.readouterr().err, arguments
        assert not (tmp_path / "run").exists(), arguments
