"""Flights with a real PX4.

The tests run if DRONECATS_PX4 names the command that starts PX4, with -d, and {instance} for its number.
"""

import contextlib
import json
import os
import signal
import socket
import subprocess
import threading
import urllib.request
from pathlib import Path

import numpy as np
import psutil
import pytest
from pymavlink import mavutil

from dronecats.report.recorded.flight import RecordedFlight
from episodes.records import catalogue
from foundation.frames import geodetic_to_ned
from foundation.run_folder import layout
from foundation.run_folder.reading import estimate
from tests.needs import needs
from tests.support.command_line import DRONECATS, last_object
from tests.support.ports import free_instance, free_port
from tests.system.courses import holds, record

COMMAND = os.environ.get("DRONECATS_PX4")
pytestmark = [pytest.mark.slow, needs("px4")]


def dronecats(*words):
    return [*DRONECATS, *words, "--px4", COMMAND]


def estimate_errors(tlog, since_us):
    """Return LOCAL_POSITION_NED minus the truth, (n, 3) m, from the episode's beginning on.

    Earlier samples do not count: before the first fixes PX4's estimate wanders by metres, and PX4 does not arm.
    """
    truth: list[tuple[float, float, float, float]] = []
    positions: list[tuple[float, float, float, float]] = []
    log = mavutil.mavlink_connection(str(tlog), dialect="development")
    while (message := log.recv_match(type=["HIL_STATE_QUATERNION", "LOCAL_POSITION_NED"])) is not None:
        if message.get_type() == "LOCAL_POSITION_NED":
            positions.append((message.time_boot_ms / 1e3, message.x, message.y, message.z))
        else:
            truth.append((message.time_usec / 1e6, message.lat / 1e7, message.lon / 1e7, message.alt / 1e3))
    origin = truth[0][1:]
    places = np.array([geodetic_to_ned(*origin, *place) for _, *place in truth])
    times, estimate = [t for t, *_ in truth], np.array([row for row in positions if row[0] >= since_us / 1e6])
    return estimate[:, 1:] - np.stack([np.interp(estimate[:, 0], times, places[:, i]) for i in range(3)], axis=1)


def test_px4_flies_towards_the_chosen_pixels_and_makes_the_turns(tmp_path):
    pilot, out = record(tmp_path / "replies.jsonl", 5), tmp_path / "run"
    episode = json.loads(catalogue.load("residential-approaching-01").to_json())
    episode["id"], episode["starts"][0]["position_ned"][2] = "high-up", -25.0
    (tmp_path / "high-up.json").write_text(json.dumps(episode))
    words = ["--episode", str(tmp_path / "high-up.json"), "--pilot", f"recorded:{pilot}", "--latency", "fixed:1"]
    fly = dronecats("fly", "--sitl", "--autopilot", "px4", "--speed", "max", "--full", "--out", str(out), *words)
    process = subprocess.run(fly, capture_output=True, text=True, timeout=800)
    assert process.returncode == 0, process.stderr + process.stdout
    # with the same sensors, PX4's estimate wanders by 4 to 5 cm between two pictures, and ours by 3 cm
    holds(out / "high-up", share=0.9, across_m=0.2)


@pytest.mark.parametrize("speed", ["1", "max"])
def test_px4_flies_an_episode_with_an_accurate_position_estimate(tmp_path, speed):
    out = tmp_path / "run"
    words = ["--pilot", "oracle", "--speed", speed, "--out", str(out), "--json"]
    process = subprocess.run(
        dronecats("fly", "--sitl", "--autopilot", "px4", *words), capture_output=True, text=True, timeout=600
    )
    assert process.returncode == 0, process.stderr + process.stdout
    result = last_object(process.stdout)
    assert result["success"]
    folder = out / result["episode"]
    begin = json.loads((folder / "truth.jsonl").open().readline())
    errors = estimate_errors(folder / "flight.tlog", begin["t0_us"])
    assert len(errors) > 100
    wandered = errors - errors[: len(errors) // 10].mean(axis=0)
    assert np.abs(wandered[:, :2]).max() < 1.0
    assert np.abs(wandered[:, 2]).max() < 1.5


def test_film_replay_and_estimate_use_the_log_on_board_px4(tmp_path):
    out = tmp_path / "run"
    words = ["--pilot", "oracle", "--speed", "max", "--keep-ulog", "--out", str(out), "--json"]
    fly = dronecats("fly", "--sitl", "--autopilot", "px4", *words)
    process = subprocess.run(fly, capture_output=True, text=True, timeout=600)
    assert process.returncode == 0, process.stderr + process.stdout
    folder = out / last_object(process.stdout)["episode"]
    streamed = RecordedFlight.read(folder).true_tracks[0]
    (folder / layout.TLOG).unlink()  # the log on board is now the best source

    kept = RecordedFlight.read(folder)  # the positions that film and replay draw
    times = np.arange(0.5, kept.end_s - 0.5, 0.25)
    assert len(times) > 20
    assert np.abs(kept.tracks[0].positions(times) - streamed.positions(times)).max() < 0.05
    assert not kept.tracks[0].level
    poses = [(kept.tracks[0].at(t).attitude, streamed.at(t).attitude) for t in times]
    assert min(abs(float(np.dot(*pair))) for pair in poses) > np.cos(np.radians(1.0) / 2)
    assert page(folder).startswith(b"<!doctype html")

    subprocess.run([*DRONECATS, "flightlog", "trace", str(folder)], check=True, timeout=300)
    trace = estimate(folder)
    assert trace is not None
    assert trace.head.source == layout.onboard_log_name()
    assert len(trace.poses) > 20
    off = [np.array(pose.position_ned) - kept.tracks[0].at(pose.t).position_ned for pose in trace.poses]
    assert np.abs(off - np.mean(off, axis=0)).max() < 1.5  # the origin of PX4's frame is the first fix


def page(folder):
    """Return the HTML page that `replay` serves."""
    command = [*DRONECATS, "replay", str(folder), "--no-browser", "--port", str(free_port(socket.SOCK_STREAM))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as replay:
        late = threading.Timer(120.0, replay.kill)
        late.start()
        assert replay.stdout is not None
        address = next(word for line in replay.stdout for word in line.split() if word.startswith("http://"))
        content = urllib.request.urlopen(address).read()
        replay.send_signal(signal.SIGINT)
        late.cancel()
    assert replay.returncode == 0
    return content


def test_px4_and_our_autopilot_fly_the_same_square(tmp_path):
    square = Path(__file__).parents[2] / "benchmarks" / "square.jsonl"
    words = ["--pilot", f"recorded:{square}", "--speed", "max", "--latency", "fixed:0.5", "--json"]
    words += ["--episode", "v1-residential-searching-01"]  # there is no obstacle on the square
    ours, px4 = tmp_path / "ours", tmp_path / "px4"
    subprocess.run([*DRONECATS, "fly", "--sitl", *words, "--out", str(ours)], check=True, timeout=300)
    fly = dronecats("fly", "--sitl", "--autopilot", "px4", *words, "--out", str(px4))
    subprocess.run(fly, check=True, timeout=600)
    compared = subprocess.run([*DRONECATS, "compare", str(ours), str(px4), "--json"], capture_output=True, text=True)
    assert compared.returncode == 0, compared.stdout + compared.stderr
    assert json.loads(compared.stdout)["agree"]


def test_a_killed_px4_is_restarted_and_the_clock_continues(tmp_path):
    state = tmp_path / "state"
    words = ["--autopilot", "px4", "--instance", str(free_instance()), "--speed", "4", "--state", str(state)]
    simulator = subprocess.Popen(dronecats("sitl", *words), stdout=subprocess.PIPE, text=True)

    def until(text):
        assert simulator.stdout is not None
        for line in simulator.stdout:
            if text in line:
                return float(line.rpartition("at ")[2].split()[0]) if " s\n" in line else None
        raise AssertionError(f"'{text}' never came")

    try:
        first_s = until("is in step")
        running = psutil.Process(simulator.pid).children(recursive=True)
        for process in running[1:]:  # the first is the guard process
            with contextlib.suppress(psutil.NoSuchProcess):  # a process of PX4's start script, which has ended
                process.kill()
        gone_s = until("has gone")
        until("is restarted")
        assert first_s <= gone_s < until("is in step")
        running = psutil.Process(simulator.pid).children(recursive=True)
        simulator.send_signal(signal.SIGINT)
        assert simulator.wait(30) == 0
        assert not [p for p in running if p.is_running()]
    finally:
        simulator.kill()
        simulator.wait()
