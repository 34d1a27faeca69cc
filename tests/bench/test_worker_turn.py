"""Flights of one worker wait for their models at the same time, although only one computes at a time."""

import dataclasses
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench import engine as local
from dronecats.bench.campaign import Batch, Campaign, EndedFlight, OpenRun
from dronecats.bench.engine import LocalEngine, Sortie
from dronecats.bench.matrix import BenchEntry
from dronecats.bench.worker import fly_flight, is_compute_bound
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, as_redacted_json
from foundation.run_folder.folder import prepare
from foundation.threads import COMPUTING

EPISODES = ("blocks-commanding-01", "blocks-commanding-02")  # a map that builds quickly
PATIENCE_S = 60.0  # to wait for the other flight's request; flights that block each other never have two
REPLY = {
    "choices": [{"message": {"content": '{"action": "rotate", "angle_deg": 5}'}}],
    "usage": {"prompt_tokens": 90, "completion_tokens": 10},
}


class Together(ThreadingHTTPServer):
    """A model server that answers the first request when the second arrives, and later requests at once."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Question)
        self.request_count, self.met, self.lock = 0, threading.Event(), threading.Lock()
        threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    @property
    def spec(self):
        return ModelSpec(provider="local", name="together", base_url=f"http://127.0.0.1:{self.server_port}/v1")


class Question(BaseHTTPRequestHandler):
    server: Together
    protocol_version = "HTTP/1.1"

    def do_GET(self):
        self.say(200, {"data": []})

    def do_POST(self):
        self.rfile.read(int(self.headers["Content-Length"]))
        with self.server.lock:
            self.server.request_count += 1
            if self.server.request_count == 2:
                self.server.met.set()
        if self.server.met.wait(PATIENCE_S):
            self.say(200, REPLY)
        else:
            self.say(400, {"error": {"message": "nobody else has asked"}})

    def say(self, status, content):
        body = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments):
        pass


# if the reply time is known in advance, the flight computes the hold meanwhile; otherwise it only waits
@pytest.mark.parametrize("latency", ["fixed:1", "tokens:0.5,100"], ids=["beside", "inline"])
def test_two_flights_of_a_worker_wait_for_their_models_at_the_same_time(tmp_path, latency):
    server = Together()
    flight = FlightSpec(
        model=server.spec, simulated=Simulated(speed=None), latency=LatencyPolicy.parse(latency), seconds=3.0, drones=1
    )
    batch = Batch(tmp_path / "run", {"flight": as_redacted_json(flight)})
    run = OpenRun(entry=BenchEntry(name="run", flight=flight, episodes=EPISODES), batch=batch, part=EPISODES)
    came: list[EndedFlight] = []
    Campaign([run], jobs=2, retry=False).fly(LocalEngine(tmp_path / "log", 2, workers=1), came.append)
    server.shutdown()
    assert [each.result.error for each in came] == [None, None]
    assert server.met.is_set()


def test_real_time_and_px4_flights_are_not_compute_bound():
    flight = FlightSpec(pilot="oracle", simulated=Simulated(speed=None))
    assert is_compute_bound(flight)
    for others in (Simulated(speed=1.0), Simulated(speed=None, autopilot="px4")):
        assert not is_compute_bound(dataclasses.replace(flight, simulated=others))


def test_a_flight_in_lockstep_waits_for_its_turn(tmp_path):
    results: list[dict[str, object]] = []
    flight = as_json(FlightSpec(episode="nowhere", pilot="oracle", simulated=Simulated(speed=None)))
    with COMPUTING.taken():
        waiting = threading.Thread(target=lambda: results.append(fly_flight(flight, tmp_path)), daemon=True)
        waiting.start()
        while not COMPUTING._queue:
            assert waiting.is_alive(), results
        assert not results
    waiting.join(60.0)
    assert "nowhere" in str(results[0]["fault"])


def hanging(flying):
    """Check the files of the flights, and return one that hangs for 100 s."""
    for flight in flying:
        flight.check(local.written_bytes(flight.sortie.folder))
    return local.hanging(flying, 100.0)


def test_a_flight_that_waits_for_its_first_turn_hangs_only_if_no_flight_advances(tmp_path, monkeypatch):
    now, flying = [0.0], []
    monkeypatch.setattr("dronecats.bench.engine.time.monotonic", lambda: now[0])
    for name in ("flies", "waits"):
        prepare(tmp_path / name)
        sortie = Sortie(flight=FlightSpec(pilot="oracle", simulated=Simulated()), folder=tmp_path / name)
        flying.append(local.InFlight(sortie=sortie))
    log = tmp_path / "flies" / "truth.jsonl"
    for now[0] in (0.0, 80.0, 160.0, 240.0):
        log.write_text(f"{now[0]}" + log.read_text())
        assert hanging(flying) is None
    now[0] = 341.0
    assert hanging(flying) is flying[0]
    assert hanging(flying[1:]) is flying[1]  # alone it waits for no other flight


def test_a_hang_before_the_first_log_line_is_detected_while_others_advance(tmp_path, monkeypatch):
    """The record exists, so the flight has had its turn. Its map build never ends."""
    now, flying = [0.0], []
    monkeypatch.setattr("dronecats.bench.engine.time.monotonic", lambda: now[0])
    for name in ("flies", "hangs"):
        prepare(tmp_path / name)
        (tmp_path / name / "episode.json").write_text("{}")
        sortie = Sortie(flight=FlightSpec(pilot="oracle", simulated=Simulated()), folder=tmp_path / name)
        flying.append(local.InFlight(sortie=sortie))
    log = tmp_path / "flies" / "truth.jsonl"
    for now[0] in (0.0, 80.0, 99.0):
        log.write_text(f"{now[0]}" + log.read_text())
        assert hanging(flying) is None
    now[0] = 101.0
    log.write_text("more" + log.read_text())
    assert hanging(flying) is flying[1]


def test_a_flight_that_only_asks_its_model_does_not_hang(tmp_path, monkeypatch):
    """A slow model may take long for the questions of one step. Each question is logged before it is asked."""
    now = [0.0]
    monkeypatch.setattr("dronecats.bench.engine.time.monotonic", lambda: now[0])
    prepare(tmp_path / "asks")
    sortie = Sortie(flight=FlightSpec(pilot="oracle", simulated=Simulated()), folder=tmp_path / "asks")
    flying = local.InFlight(sortie=sortie)
    flying.check(local.written_bytes(sortie.folder))
    now[0] = 90.0
    assert flying.silent_s == 90.0
    (sortie.folder / "prompts.jsonl").write_text("{}\n")
    flying.check(local.written_bytes(sortie.folder))
    assert flying.silent_s == 0.0
