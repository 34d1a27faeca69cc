"""Flights with real processes and sockets, and the effects of killed and stopped processes."""

import json
import os
import signal
import subprocess
import threading
import time

import psutil
import pytest

from dronecats.flight.run.pilot import PILOT
from dronecats.flight.stages.stage import CAMERA, LOGGER, SIMULATOR
from dronecats.pilots.server import PilotServer
from tests.support.command_line import DRONECATS, last_object
from tests.support.first_question import after_first_question

MODULES = {part.name: part.part for part in (SIMULATOR, CAMERA, LOGGER, PILOT)}


class Flight:
    """`dronecats fly --sitl` as a user starts it."""

    def __init__(self, out, *arguments):
        command = [*DRONECATS, "fly", "--sitl", "--out", str(out), "--json", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.out = out
        self.children = []

    def until(self, text):
        assert self.process.stdout is not None
        assert self.process.stderr is not None
        for line in self.process.stdout:
            if text in line:
                self.children = psutil.Process(self.process.pid).children(recursive=True)
                return
        raise AssertionError(f"'{text}' never came; {self.process.stderr.read()}")

    def child(self, kind):
        return next(c for c in self.children if c.cmdline()[-1] == MODULES[kind])

    def ends(self, timeout=300):
        assert self.process.stdout is not None
        late = threading.Timer(timeout, self.process.kill)
        late.start()
        out = self.process.stdout.read()  # `communicate` would lose the lines that `until` has buffered
        _, errors = self.process.communicate()
        late.cancel()
        assert not [c for c in self.children if c.is_running() and c.status() != psutil.STATUS_ZOMBIE]
        return self.process.returncode, out, errors


@pytest.fixture
def fly(tmp_path):
    flights = []

    def start(*arguments):
        flights.append(Flight(tmp_path / "run", *arguments))
        return flights[-1]

    yield start
    for flight in flights:
        if flight.process.poll() is None:
            flight.process.kill()
            flight.process.wait()


@pytest.mark.slow("flies in real time")
def test_a_flight_in_real_time_succeeds(fly):
    code, out, errors = fly("--speed", "3").ends(800)
    assert code == 0, errors
    result = last_object(out)
    assert result["success"]
    assert result["real_time_factor"] < 3.2  # paced; a benchmark measures the pace on a busy machine


@pytest.mark.slow("flies in real time")
@pytest.mark.parametrize("kind", ["logger", "camera", "pilot", "simulator"])
def test_a_killed_process_ends_the_flight_with_status_3_and_a_one_line_error(fly, kind):
    flight = fly("--speed", "3", "--pilot", "blind")
    flight.until("   0  t=")
    os.kill(flight.child(kind).pid, signal.SIGKILL)
    code, out, errors = flight.ends()
    assert code == 3
    assert kind in errors
    assert len(errors.strip().splitlines()) == 1
    result = last_object(out)
    assert result["outcome"] == "error"
    verdict = json.loads((flight.out / result["episode"] / "verdict.json").read_text())
    assert verdict["outcome"] == "error"


@pytest.mark.slow("waits until a child that hangs is given up")
@pytest.mark.parametrize("kind", ["logger", "camera", "pilot", "simulator"])
def test_a_hanging_process_is_reported_with_its_log_within_30_s(fly, kind):
    flight = fly("--speed", "3", "--pilot", "blind")
    flight.until("   0  t=")
    began_s = time.monotonic()
    os.kill(flight.child(kind).pid, signal.SIGSTOP)
    out = ""
    for line in flight.process.stdout:
        out += line
        if "process hangs" in line:
            break
    assert time.monotonic() - began_s < 30.0  # from then on, the time depends on the landing
    code, rest, errors = flight.ends()
    out += rest
    assert code == 3
    (sentence,) = errors.strip().splitlines()
    assert f"the {kind} process hangs" in sentence
    result = last_object(out)
    assert sentence.endswith(f"{result['run_dir']}/{kind}.log")
    assert result["outcome"] == "error"
    assert kind == "simulator" or "landing" in out


@pytest.mark.slow("flies and lands in real time")
@pytest.mark.parametrize("when", ["waiting until", "taking off", "flying to the start pose", "   1  t="])
def test_ctrl_c_lands_and_ends_all_processes(fly, when):
    flight = fly("--speed", "3", "--pilot", "blind")
    flight.until(when)
    flight.process.send_signal(signal.SIGINT)
    code, out, errors = flight.ends()
    assert code == 130
    assert "interrupted" in errors
    if when not in ("waiting until", "taking off"):  # earlier, the vehicle may still be on the ground and only disarm
        assert "landing" in out
    assert last_object(out)["outcome"] == "error"


@pytest.mark.slow
def test_a_killed_agent_leaves_no_process(fly):
    flight = fly("--speed", "3", "--pilot", "blind")
    flight.until("   0  t=")
    flight.process.kill()
    _, alive = psutil.wait_procs(flight.children, timeout=10)
    assert not alive


@pytest.mark.slow
def test_ctrl_c_does_not_wait_for_a_silent_model(fly):
    was_asked, never = threading.Event(), threading.Event()

    def silent(prompt, images):
        was_asked.set()
        never.wait()
        return "{}"

    with PilotServer(after_first_question(silent), "m") as server:
        flight = fly("--speed", "3", "--model", "local/m", "--base-url", server.base_url)
        flight.until("flying to the start pose")
        assert was_asked.wait(300)
        flight.process.send_signal(signal.SIGINT)
        code, out, _ = flight.ends(300)
        never.set()
    assert code == 130
    assert "landing" in out
