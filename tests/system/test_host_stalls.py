"""A real-time flight whose processes are stopped on purpose, under a model that is slow by itself."""

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

SPEED = 0.5  # half of what a busy machine loses is lost of vehicle time
STOPPED_S = 3.0  # wall s; the link takes 5 s for the end
BLIND_S = 6.0  # wall s, from the decision on: the next picture is wanted when its action has been flown, 1 … 3 s later
MODEL_S = 4.0  # wall s: in vehicle time eight times what a host may lose


def part(name: str) -> psutil.Process:
    """Return the child of this process that is this part of the flight."""
    (found,) = children(f"dronecats.flight.sitl.{name}")
    return found


def lag_and_wait(decision: Decision) -> float:
    """Return all that is the host's of a step, s."""
    assert isinstance(decision.host_lag_s, float)
    assert isinstance(decision.frame_wait_s, float)
    return max(decision.host_lag_s, decision.frame_wait_s)


@pytest.mark.slow("flies in real time, stalled and not")
def test_who_was_late_is_told_step_by_step(tmp_path):
    asked, stopped = threading.Event(), {1: "simulator_process", 3: "camera"}
    steps = []

    def answer(prompt, pictures):
        asked.wait(MODEL_S)
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
            seconds=20.0, full=True,
        )  # fmt: skip
        result = fly(spec, tmp_path / "run", say)
    folder = tmp_path / "run" / "residential-approaching-01"
    told = list(rows(folder / "decisions.jsonl", Decision))
    assert len(told) >= 5, result
    assert isinstance(told[2].host_lag_s, float)
    assert told[2].host_lag_s > SPEED * STOPPED_S - STALL_S  # the step after the simulator was stopped
    assert isinstance(told[4].frame_wait_s, float)
    assert told[4].frame_wait_s > 2.0 * STALL_S
    assert all(each.latency_s is not None and each.latency_s > SPEED * MODEL_S * 0.9 for each in told)
    # were the model's time the host's, no step would be below it; whether a busy machine delays one is its own matter
    assert min(lag_and_wait(each) for each in told) < SPEED * MODEL_S * 0.9
    verdict = json_object(folder / "verdict.json")
    assert verdict is not None
    assert verdict["host_stalls"] == result["host_stalls"] == sum(map(delayed, told)) >= 2
    assert json.loads((folder.parent / "run.json").read_text())["pace"]["skipped_s"] > 0.0
