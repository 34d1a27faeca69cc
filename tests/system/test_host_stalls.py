"""A real-time flight with a slow model. The test stops the simulator and the camera for some seconds."""

import json
import os
import signal
import threading

import psutil
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.judge.diagnostics import STALL_S, delayed
from dronecats.pilots.server import PilotServer
from foundation.run_folder.reading import json_object, rows
from foundation.run_folder.rows import Decision
from tests.support.children import children

SPEED = 0.5  # at half speed, a host delay of 1 s is a vehicle delay of 0.5 s
STOPPED_S = 3.0  # wall s; after 5 s of silence the link counts as lost
BLIND_S = 6.0  # wall s, from the decision on; the next picture is due after the action, 1 … 3 s later
MODEL_S = 4.0  # wall s; in vehicle time, eight times the delay that the host may have


def part(name: str) -> psutil.Process:
    """Return the child process with this role in the flight."""
    (child,) = children(f"dronecats.flight.sitl.{name}")
    return child


def lag_and_wait(decision: Decision) -> float:
    """Return the longer of a step's host lag and frame wait, s."""
    assert isinstance(decision.host_lag_s, float)
    assert isinstance(decision.frame_wait_s, float)
    return max(decision.host_lag_s, decision.frame_wait_s)


@pytest.mark.slow("flies in real time, stalled and not")
def test_delays_of_host_and_camera_are_recorded_step_by_step(tmp_path):
    pause, stopped = threading.Event(), {0: "simulator_process", 2: "camera"}
    steps = []

    def answer(prompt, pictures):
        pause.wait(MODEL_S)
        return '{"action": "rotate", "angle_deg": 30}'

    def say(line):
        if line[:4].strip().isdecimal():
            steps.append(int(line[:4]))
            name = stopped.get(steps[-1])
            if name:
                child = part(name)
                os.kill(child.pid, signal.SIGSTOP)
                seconds = STOPPED_S if name == "simulator_process" else BLIND_S
                threading.Timer(seconds, os.kill, (child.pid, signal.SIGCONT)).start()

    with PilotServer(answer, "slow") as server:
        model = ModelSpec(provider="local", name="slow", base_url=server.base_url)
        spec = FlightSpec(
            episode="residential-approaching-01", model=model, simulated=Simulated(speed=SPEED),
            latency=LatencyPolicy.parse("real"),
            seconds=30.0, full=True,  # enough for four steps, even if the machine pauses the flight
        )  # fmt: skip
        result = fly(spec, tmp_path / "run", say)
    folder = tmp_path / "run" / "residential-approaching-01"
    decisions = list(rows(folder / "decisions.jsonl", Decision))
    assert len(decisions) >= 4, result
    assert isinstance(decisions[1].host_lag_s, float)
    assert decisions[1].host_lag_s > SPEED * STOPPED_S - STALL_S  # the step after the simulator was stopped
    assert isinstance(decisions[3].frame_wait_s, float)
    assert decisions[3].frame_wait_s > 2.0 * STALL_S
    assert all(decision.latency_s is not None and decision.latency_s > SPEED * MODEL_S * 0.9 for decision in decisions)
    # If model time counted as host time, every step would exceed this limit.
    # The test takes the minimum, because a busy machine may delay single steps.
    assert min(lag_and_wait(decision) for decision in decisions) < SPEED * MODEL_S * 0.9
    verdict = json_object(folder / "verdict.json")
    assert verdict is not None
    assert verdict["host_stalls"] == result["host_stalls"] == sum(map(delayed, decisions)) >= 2
    assert json.loads((folder.parent / "run.json").read_text())["pace"]["skipped_s"] > 0.0
