"""`fly --connect` with a real PX4 that simulates itself (SIH). The test kills PX4 in flight.

DRONECATS_PX4 names the command that starts PX4, as in test_real_px4.py.
"""

import json
import os
import signal
import subprocess
import threading

import pytest

from dronecats.flight.sitl.px4 import Px4Process
from dronecats.flight.sitl.sockets import AGENT_PORT, TRUTH_PORT
from tests.needs import needs
from tests.support.children import children
from tests.support.command_line import DRONECATS
from tests.support.ports import free_instance

COMMAND = os.environ.get("DRONECATS_PX4", "")
pytestmark = [pytest.mark.slow, needs("px4")]


class Vehicle:
    """A PX4 that simulates itself, and its flight on one of our maps."""

    def __init__(self, folder):
        self.folder, self.instance = folder, free_instance()
        self.px4 = Px4Process(COMMAND, self.instance, folder / "px4", folder / "px4.log", 1.0)

    def send(self, number):
        """Send a signal to PX4's processes, but not to the guard that watches them."""
        (guard,) = children("dronecats.flight.processes.guard")
        for process in guard.children(recursive=True):
            process.send_signal(number)

    def fly(self, on_first_step, seconds):
        """Fly; return the exit status, the lines of the terminal and the result."""
        (self.folder / "envelope.toml").write_text("frame_s = 100\n")  # a busy machine renders slowly
        turns = [json.dumps({"step": k, "reply": '{"action": "rotate", "angle_deg": 30}'}) for k in range(100)]
        (self.folder / "turns.jsonl").write_text("\n".join(turns) + "\n")
        words = [
            "--connect", f"udpin://127.0.0.1:{AGENT_PORT + self.instance}",
            "--truth", f"udpin://127.0.0.1:{TRUTH_PORT + self.instance}",
            "--world", "residential", "--instruction", "Go to the cyan SUV.", "--arm",
            "--pilot", f"recorded:{self.folder / 'turns.jsonl'}", "--envelope", str(self.folder / "envelope.toml"),
            "--seconds", str(seconds), "--out", str(self.folder / "run"), "--json",
        ]  # fmt: skip
        flight = subprocess.Popen(
            [*DRONECATS, "fly", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self.folder,
        )
        assert flight.stdin is not None
        assert flight.stdout is not None
        late = threading.Timer(500.0, flight.kill)
        late.start()
        flight.stdin.write("ARM\n")
        flight.stdin.close()
        lines, steps = [], 0
        try:
            for line in flight.stdout:
                lines.append(line)
                if line[:4].strip().isdecimal():
                    steps += 1
                    if steps == 1:
                        on_first_step(self)
            status = flight.wait()
        finally:
            late.cancel()
            flight.kill()
            flight.wait()
        assert steps, lines
        (result,) = [line for line in lines if line.startswith("{")]
        return status, lines, json.loads(result)


@pytest.fixture
def vehicle(tmp_path, monkeypatch):
    monkeypatch.setenv("PX4_SIM_MODEL", "sihsim_quadx")
    monkeypatch.delenv("PX4_SYS_AUTOSTART", raising=False)
    vehicle = Vehicle(tmp_path)
    yield vehicle
    vehicle.px4.close()


def test_a_killed_px4_ends_the_flight_with_a_one_line_error(vehicle):
    status, lines, result = vehicle.fly(lambda vehicle: vehicle.send(signal.SIGKILL), 120.0)
    assert status == 3, lines
    assert result["outcome"] == "error"
    (message,) = [line for line in lines if line.startswith("dronecats fly: ")]
    assert f"{AGENT_PORT + vehicle.instance} has been silent" in message
    assert lines[-1].startswith(("{", "dronecats fly: "))
