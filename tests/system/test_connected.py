"""`fly --connect` with a vehicle that another process started: arming, control, and a dry run."""

import contextlib
import json
import signal
import subprocess
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from dronecats.judge.diagnostics import delayed
from foundation.mavlink import MODES, Packer, dialect
from foundation.run_folder.reading import rows
from foundation.run_folder.rows import Decision
from tests.support.children import children
from tests.support.command_line import DRONECATS, last_object
from tests.support.first_question import is_first_question
from tests.support.simulated_vehicle import simulated_rig
from tests.support.wire_tap import Tap, orders, setpoints

pytestmark = pytest.mark.slow("whole flights in real time")


@pytest.fixture
def field(tmp_path):
    """Each flight has a new vehicle. After a landing against the SUV, a vehicle cannot take off again."""
    with simulated_rig(tmp_path) as rig:
        yield rig


@pytest.fixture
def tap(field):
    with Tap(field[0]) as tap:
        yield tap


def fly(tap, camera, tmp_path, *more):
    (tmp_path / "envelope.toml").write_text("frame_s = 100\n")  # a busy machine renders slowly
    command = [
        *DRONECATS, "fly", "--connect", tap.url, "--camera", camera,
        "--instruction", "Go to the cyan SUV.", "--out", str(tmp_path / "run"), "--json",
        "--envelope", str(tmp_path / "envelope.toml"), *more,
    ]  # fmt: skip
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )


def test_typing_arm_starts_a_flight_that_holds_and_then_lands(field, tap, tmp_path):
    flight = fly(tap, field[1], tmp_path, "--arm", "--seconds", "15")
    out, err = flight.communicate("ARM\n", timeout=240)
    assert flight.returncode == 0, err
    result = last_object(out)
    assert result["success"] is None  # no truth is measured
    assert result["steps"] > 1
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["firmware"].startswith("PX4 ")
    flight = run["flight"]
    assert flight["envelope"]["ceiling_m"] == 30.0
    assert flight["connected"]["authority"] == {"arm": True, "then": "land", "dry": False}
    modes = [m.param2 * 100 + m.param3 for m in tap.of("agent", "COMMAND_LONG") if m.command == 176]
    assert modes[-2:] == [403, 406]  # hold, then land


def test_without_the_typed_confirmation_nothing_is_sent(field, tap, tmp_path):
    flight = fly(tap, field[1], tmp_path, "--arm")
    _, err = flight.communicate("yes\n", timeout=60)
    assert flight.returncode == 2
    assert "ARM" in err
    assert tap.passed == []
    assert not (tmp_path / "run").exists()


def test_a_person_hands_over_control_and_takes_it_back(field, tap, tmp_path):
    flight = fly(tap, field[1], tmp_path)
    tap.until(lambda: tap.of("vehicle", "SYS_STATUS"), flight=flight)
    tap.until(lambda: tap.of("vehicle", "SYS_STATUS")[-1].onboard_control_sensors_health & 0x10000000, flight=flight)
    person = Packer(255, 190)
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    nan = float("nan")
    tap.far.send(person.pack(arm))
    tap.until(lambda: any(m.base_mode & 128 for m in tap.of("vehicle", "HEARTBEAT")))
    tap.far.send(person.pack(dialect.MAVLink_command_long_message(1, 1, 22, 0, *(nan,) * 7)))
    offboard = MODES["OFFBOARD"].custom_mode
    tap.until(lambda: tap.of("vehicle", "HEARTBEAT")[-1].custom_mode == offboard, flight=flight)
    tap.until(lambda: any(m.coordinate_frame == 8 and m.vx > 0.5 for m in setpoints(tap)), flight=flight)
    tap.order("HOLD")
    out, err = flight.communicate(timeout=120)
    assert flight.returncode == 3
    assert "HOLD" in err
    assert last_object(out)["outcome"] in ("unknown", "error")
    with tap.lock:
        passed = list(tap.passed)
    shown = next(
        i for i, (side, m) in enumerate(passed)
        if side == "vehicle" and m.get_type() in ("HEARTBEAT", "CURRENT_MODE") and i > 0
        and m.custom_mode == MODES["HOLD"].custom_mode
        and any(n.get_type() in ("HEARTBEAT", "CURRENT_MODE") and n.custom_mode == offboard
                for s, n in passed[:i] if s == "vehicle")
    )  # fmt: skip
    # one setpoint may already have been on the wire when the vehicle reported
    after = [m for s, m in passed[shown:] if s == "agent" and m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]
    assert len(after) <= 1
    assert orders(tap) == {176}  # only the mode command
    assert [m.param2 for m in tap.of("agent", "COMMAND_LONG") if m.command == 176] == [6.0]
    tap.order("LAND")
    tap.until(lambda: not tap.of("vehicle", "HEARTBEAT")[-1].base_mode & 128)


def simulator():
    """Return the process of the vehicle."""
    (process,) = children("dronecats.flight.sitl.simulator_process")
    return process


def test_a_pause_of_the_vehicle_process_is_reported_and_marks_the_steps(field, tap, tmp_path):
    # a longer flight may come near the SUV and land on it
    flight = fly(tap, field[1], tmp_path, "--arm", "--seconds", "15")
    flight.stdin.write("ARM\n")
    flight.stdin.flush()
    tap.until(lambda: any(m.coordinate_frame == 8 for m in setpoints(tap)), flight=flight)
    simulator().send_signal(signal.SIGSTOP)
    time.sleep(3.0)
    simulator().send_signal(signal.SIGCONT)
    out, err = flight.communicate(timeout=240)
    assert flight.returncode == 0, err
    assert "no telemetry for" in out
    decisions = list(rows(tmp_path / "run" / "connected" / "decisions.jsonl", Decision))
    assert max(decision.host_lag_s for decision in decisions if isinstance(decision.host_lag_s, float)) > 2.0
    assert sum(map(delayed, decisions)) >= 1


def test_the_loss_of_the_vehicle_ends_the_flight(field, tap, tmp_path):
    flight = fly(tap, field[1], tmp_path, "--arm")
    flight.stdin.write("ARM\n")
    flight.stdin.flush()
    tap.until(lambda: any(m.coordinate_frame == 8 for m in setpoints(tap)), flight=flight)
    simulator().kill()
    out, err = flight.communicate(timeout=60)  # tests/hil/link/test_silence.py tests the time, on the link's own clock
    assert flight.returncode == 3
    assert "silent" in err
    assert last_object(out)["outcome"] == "error"


class DeafModel(BaseHTTPRequestHandler):
    """Lists its models, and answers only the question before take-off at once. Other replies take 60 s."""

    def do_GET(self):
        self.send_response(200)
        self.end_headers()

    def do_POST(self):
        if not is_first_question(self.rfile.read(int(self.headers["Content-Length"])).decode()):
            time.sleep(60.0)
        body = b'{"choices": [{"message": {"content": "{}"}}]}'
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        with contextlib.suppress(OSError):  # the client has disconnected
            self.wfile.write(body)

    def log_message(self, *args):
        pass


def test_with_a_model_that_hangs_the_vehicle_holds_and_then_lands(field, tap, tmp_path):
    server = ThreadingHTTPServer(("127.0.0.1", 0), DeafModel)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    model = ("--model", "local/deaf", "--base-url", f"http://127.0.0.1:{server.server_port}/v1", "--patience", "6")
    flight = fly(tap, field[1], tmp_path, "--arm", *model)
    _, err = flight.communicate("ARM\n", timeout=240)
    server.shutdown()
    assert flight.returncode == 3
    assert " 6 s" in err
    assert all(m.coordinate_frame == 1 for m in setpoints(tap))  # positions to hold, and no velocity
    modes = [m.param2 * 100 + m.param3 for m in tap.of("agent", "COMMAND_LONG") if m.command == 176]
    assert modes[-2:] == [403, 406]
    assert not tap.of("vehicle", "HEARTBEAT")[-1].base_mode & 128


def test_a_dry_run_draws_every_step_and_sends_no_commands(field, tap, tmp_path):
    flight = fly(tap, field[1], tmp_path, "--dry-run", "--seconds", "10")
    _, err = flight.communicate(timeout=120)
    assert flight.returncode == 0, err
    assert setpoints(tap) == []
    assert orders(tap) == set()
    run = tmp_path / "run" / "connected"
    steps = len((run / "decisions.jsonl").read_text().splitlines())
    assert steps >= 2
    assert len(list((run / "intent").glob("*.jpg"))) == steps
