"""`dronecats study rate` on a running vehicle, compared with the times that the model's server records."""

import csv
import json
import signal
import subprocess
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise

import pytest

from dronecats.flight.run.fly import fly
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated, latency_policy
from tests.support.command_line import DRONECATS, last_object
from tests.support.first_question import is_first_question
from tests.support.json_lines import rows
from tests.support.simulated_vehicle import simulated_rig
from tests.support.wire_tap import Tap, orders, setpoints

pytestmark = pytest.mark.slow
TAKES_S = (0.05, 0.35, 0.12, 0.6, 0.2, 0.08)  # reply times of the questions, in order
BUSY = 2  # index of the question whose first attempt gets status 503
ROTATE = '{"action": "rotate", "angle_deg": 1}'  # a short move
FINISHED = '{"action": "finished"}'  # the step takes 2.5 s


class KnownModel(ThreadingHTTPServer):
    """Answers each question after a known time, and records each real duration."""

    daemon_threads = True

    def __init__(self, dies_after=None, reply=ROTATE):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.took_s, self.refused_s, self.dies_after, self.reply = [], [], dies_after, reply
        threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    @property
    def words(self):
        return ("--model", "local/known", "--base-url", f"http://127.0.0.1:{self.server_port}/v1")


class _Handler(BaseHTTPRequestHandler):
    server: KnownModel

    def do_GET(self):
        self.answer(200, {"data": []})

    def do_POST(self):
        prompt = self.rfile.read(int(self.headers["Content-Length"])).decode()
        if is_first_question(prompt):
            return self.answer(200, {"choices": [{"message": {"content": FINISHED}}]})
        began_s, number = time.monotonic(), len(self.server.took_s)
        if number == self.server.dies_after:
            return self.answer(401, {"error": {"message": "no more"}})
        if number == BUSY and not self.server.refused_s:
            self.server.refused_s.append(0.25)
            return self.answer(503, {"error": {"message": "busy"}}, {"Retry-After": "0.25"})
        time.sleep(TAKES_S[number % len(TAKES_S)])
        message = {"role": "assistant", "content": self.server.reply}
        self.server.took_s.append(time.monotonic() - began_s)
        return self.answer(200, {"choices": [{"index": 0, "message": message, "finish_reason": "stop"}]})

    def answer(self, status, body, headers=()):
        data = json.dumps(body).encode()
        self.send_response(status)
        for name, value in dict(headers).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args):
        pass


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A vehicle at rest that never moves, so all tests can share its camera."""
    with simulated_rig(tmp_path_factory.mktemp("rig")) as rig:
        yield rig


@pytest.fixture
def tap(rig):
    with Tap(rig[0]) as tap:
        yield tap


def measure(tap, camera, folder, *more):
    (folder / "envelope.toml").write_text("frame_s = 100\n")  # a busy machine renders slowly
    command = [
        *DRONECATS, "study", "rate", "--connect", tap.url, "--camera", camera, "--dry-run", "--json",
        "--envelope", str(folder / "envelope.toml"), "--out", str(folder / "run"), *more,
    ]  # fmt: skip
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder)


def questions(folder):
    with (folder / "run" / "chain.csv").open(newline="") as file:
        return [{name: float(value or "nan") for name, value in row.items()} for row in csv.DictReader(file)]


def only_listened(tap):
    """Return whether the agent sent only heartbeats and telemetry requests."""
    with tap.lock:
        kinds = {message.get_type() for side, message in tap.passed if side == "agent"}
    return kinds == {"HEARTBEAT", "COMMAND_LONG"} and orders(tap) == set() and setpoints(tap) == []


def test_the_study_measures_without_motion_and_its_trace_sets_the_latencies_of_a_flight(rig, tap, tmp_path):
    model = KnownModel()
    measuring = measure(tap, rig[1], tmp_path, *model.words, "--questions", "8")
    out, err = measuring.communicate(timeout=240)
    model.shutdown()
    assert measuring.returncode == 0, err
    assert only_listened(tap)
    report, question_rows = last_object(out), questions(tmp_path)
    assert report["questions"] == report["wanted"] == len(question_rows) == 8
    assert report["age_since"] == "capture"  # our camera stamps its pictures

    # each measured time includes the server's time; failed attempts are separate
    assert len(model.took_s) == 8
    assert all(took_s <= row["model_s"] for took_s, row in zip(model.took_s, question_rows, strict=True))
    assert question_rows[BUSY]["failed_s"] >= 0.25
    for row in question_rows:
        links = sum(row[name] for name in ("wait_s", "encode_s", "failed_s", "model_s", "parse_s", "tick_s"))
        assert links == pytest.approx(row["step_s"], abs=1e-5)
        assert all(row[name] > 0.0 for name in ("wait_s", "encode_s", "parse_s", "tick_s"))
        charged = row["encode_s"] + row["model_s"] + row["parse_s"]
        assert row["latency_s"] == pytest.approx(charged, abs=1e-5)

    # the agent's log and the report agree with the rows
    decisions = list(rows(tmp_path / "run" / "connected" / "decisions.jsonl"))
    assert [d["frame_id"] for d in decisions] == [row["frame_id"] for row in question_rows]
    assert report["links"]["model_s"]["max"] == max(row["model_s"] for row in question_rows)

    # the latencies of a lockstep flight are exactly the measured ones, in a cycle from a random row
    result = fly(
        FlightSpec(
            episode="residential-approaching-01", pilot="oracle", seconds=40.0,
            simulated=Simulated(speed=None, rendered=False),
            latency=latency_policy(f"trace:{tmp_path / 'run' / 'trace.csv'}"),
        ),
        tmp_path / "flown",
        lambda line: None,
    )  # fmt: skip
    charged = [row["latency_s"] for row in question_rows]
    cost = [d["latency_s"] for d in rows(tmp_path / "flown" / "residential-approaching-01" / "decisions.jsonl")]
    assert result["steps"] == len(cost) > 3
    first = charged.index(cost[0])
    assert cost == [charged[(first + step) % 8] for step in range(len(cost))]


def test_measurements_before_a_model_failure_are_kept(rig, tap, tmp_path):
    model = KnownModel(dies_after=6)
    measuring = measure(tap, rig[1], tmp_path, *model.words)
    out, err = measuring.communicate(timeout=240)
    model.shutdown()
    assert measuring.returncode == 3
    assert "no more" in err.splitlines()[-1]
    report = last_object(out)
    assert (report["questions"], report["wanted"], report["status"]) == (6, 30, 3)
    assert len(questions(tmp_path)) == 6
    assert len((tmp_path / "run" / "trace.csv").read_text().splitlines()) == 1 + 6
    assert only_listened(tap)


def test_ctrl_c_ends_the_study_and_keeps_its_measurements(rig, tap, tmp_path):
    model = KnownModel()
    measuring = measure(tap, rig[1], tmp_path, *model.words)
    tap.until(lambda: len(model.took_s) >= 3, seconds=120.0, flight=measuring)
    measuring.send_signal(signal.SIGINT)
    out, err = measuring.communicate(timeout=120)
    model.shutdown()
    assert measuring.returncode == 130, err
    assert "interrupted after" in err
    question_rows = questions(tmp_path)
    assert last_object(out)["questions"] == len(question_rows) >= 2
    assert all(earlier["step"] < later["step"] for earlier, later in pairwise(question_rows))
    assert only_listened(tap)


def test_a_too_short_duration_is_a_usage_error(rig, tap, tmp_path):
    model = KnownModel(reply=FINISHED)
    measuring = measure(tap, rig[1], tmp_path, *model.words, "--seconds", "9.5")
    out, err = measuring.communicate(timeout=120)
    model.shutdown()
    assert measuring.returncode == 2, err
    assert "--seconds" in err.splitlines()[-1]
    assert last_object(out)["status"] == 2
