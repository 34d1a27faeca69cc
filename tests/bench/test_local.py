"""Workers are real processes: they fly, are killed or hang. The next run flies the remaining flights."""

import dataclasses
import os
import re
import signal
import socket
import subprocess
import sys
import threading

import psutil
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import ModelSpec
from dronecats.bench.campaign import Batch, Campaign, EndedFlight, OpenRun
from dronecats.bench.engine import ANSWER_S, LocalEngine, Sortie
from dronecats.bench.matrix import BenchEntry
from dronecats.cli.main import main
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from episodes.records import catalogue
from foundation.errors import InfrastructureError
from foundation.run_folder import layout
from tests.support.children import children
from tests.support.command_line import last_object

ORACLE = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))
SHORT = dataclasses.replace(ORACLE, seconds=2.0, full=True)
EASY = "residential-approaching-01"
TWO = ("blocks-commanding-01", "blocks-commanding-02")  # each worker builds its map, and the map blocks builds quickly


def audit(out, *arguments):
    command = [sys.executable, "-m", "dronecats.cli.main", "episodes", "audit", "--json", "--out", str(out), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def batch_of(folder, flight):
    return Batch(folder, {"flight": as_redacted_json(flight)})


def campaign(batch, flight, episodes, jobs=1):
    run = OpenRun(
        entry=BenchEntry(name="run", flight=flight, episodes=tuple(episodes)), batch=batch, part=tuple(episodes)
    )
    return Campaign([run], jobs=jobs, retry=False)


def fly(batch, flight, episodes, jobs=1, engine=LocalEngine, **how):
    """Fly the remaining flights, and return the results by episode."""
    came: list[EndedFlight] = []
    made = engine(batch.run / "worker.log", jobs, **how)
    campaign(batch, flight, episodes, jobs).fly(made, came.append)
    return {each.result.episode: each.result for each in came}


def workers():
    """Return the child processes that are workers."""
    return children("dronecats.flight.processes.child")


def flown_bytes(folder):
    return {name: (folder / name).read_bytes() for name in ("truth.jsonl", "decisions.jsonl", "verdict.json")}


def test_an_episode_solved_by_the_oracle_is_not_flown_again(tmp_path, capsys):
    def report_of(*episodes):
        assert main(["episodes", "audit", "--json", "--out", str(tmp_path / "run"), *episodes]) == 0
        return last_object(capsys.readouterr().out)

    report = report_of(EASY)
    assert report["unsolved"] == {}
    assert report["rows"][-1]["solved"] == report["rows"][-1]["flown"] == 1
    log = tmp_path / "run" / EASY / "decisions.jsonl"
    written_ns = log.stat().st_mtime_ns
    file = tmp_path / "mine.json"
    file.write_text(catalogue.load(EASY).to_json())
    assert report_of(str(file))["rows"] == report["rows"]
    assert log.stat().st_mtime_ns == written_ns


@pytest.mark.slow("flights with pictures, together and alone")
def test_flights_that_share_a_worker_equal_flights_flown_alone(tmp_path):
    """State that a process keeps for all flights must not change any of them."""
    seen = FlightSpec(
        pilot="vision",
        simulated=Simulated(speed=None),
        latency=LatencyPolicy.parse("fixed:0.1"),
        seconds=6.0,
        full=True,
    )
    # one map twice, a fleet, and a target that moves
    episodes = [EASY, "residential-tracking-01", "blocks-commanding-01"]
    together, alone = (batch_of(tmp_path / name, seen) for name in ("together", "alone"))
    begun: list[tuple[int, Sortie]] = []

    class Gathering(LocalEngine):
        def _turn(self, worker, fresh, flying):
            begun.extend((worker.pid, sortie) for sortie in fresh)
            super()._turn(worker, fresh, flying)

    fly(together, seen, episodes, jobs=3, engine=Gathering, workers=1)
    assert len(begun) == len(episodes)
    assert len({pid for pid, _ in begun}) == 1
    fly(alone, seen, episodes)
    for episode in episodes:
        assert flown_bytes(together.folder(episode)) == flown_bytes(alone.folder(episode))


def test_a_pinned_rate_equals_a_fixed_latency_byte_for_byte(fly_once):
    alone = dataclasses.replace(SHORT, episode=TWO[0], drones=1, seconds=3.0)
    pinned, charged = (
        dataclasses.replace(alone, latency=LatencyPolicy.parse(policy)) for policy in ("rate:2", "fixed:0.5")
    )
    two = [flown_bytes(fly_once(spec).run / TWO[0]) for spec in (pinned, charged)]
    assert two[0] == two[1]
    assert b'"latency_s": 0.5' in two[0]["decisions.jsonl"]


def test_a_flight_with_an_unknown_map_fails_alone(tmp_path):
    """The other flights of its worker go on, since no process has died."""
    batch = batch_of(tmp_path / "run", SHORT)
    lost = TWO[1]
    batch._records[lost] = dataclasses.replace(batch._record(lost), map="nowhere")
    results = fly(batch, SHORT, TWO, jobs=2, workers=1)
    assert results[TWO[0]].outcome == "failure"
    assert results[lost].outcome == "error"
    assert "nowhere" in str(results[lost].error)


def test_a_killed_worker_loses_only_its_episode(tmp_path):
    batch, killed = batch_of(tmp_path / "run", SHORT), []

    class Fragile(LocalEngine):
        """Kills the worker of the second episode when its flight starts."""

        def _turn(self, worker, fresh, flying):
            if [each for each in fresh if each.folder.name == TWO[1]]:
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)
            super()._turn(worker, fresh, flying)

    results = fly(batch, SHORT, TWO, engine=Fragile)
    assert len(killed) == 1
    assert {name: each.outcome for name, each in results.items()} == dict(zip(TWO, ("failure", "error"), strict=True))
    assert batch.left(TWO) == [TWO[1]]
    assert fly(batch, SHORT, TWO, jobs=2)[TWO[1]].outcome == "failure"
    assert not workers()


@pytest.mark.slow
def test_a_worker_that_hangs_is_killed_and_its_flight_is_an_error(tmp_path):
    """A stopped process does not answer and does not end."""
    batch = batch_of(tmp_path / "run", SHORT)
    stopped: list[int] = []

    class Frozen(LocalEngine):
        def _turn(self, worker, fresh, flying):
            if not stopped:
                stopped.append(worker.pid)
                os.kill(worker.pid, signal.SIGSTOP)
            self._answer_s = 3.0 if worker and worker.pid == stopped[0] else ANSWER_S  # the next worker may be slow
            super()._turn(worker, fresh, flying)

    results = fly(batch, SHORT, TWO, engine=Frozen)
    assert results[TWO[0]].outcome == "error"
    assert "hangs" in str(results[TWO[0]].error)
    assert results[TWO[1]].outcome == "failure"
    assert not psutil.pid_exists(stopped[0])
    assert not workers()


@pytest.mark.slow
def test_a_flight_that_hangs_is_an_error_although_its_worker_answers(tmp_path):
    """The model never replies. Its client waits for 300 s, but the limit of the campaign is shorter."""
    sockets, was_asked = [], threading.Event()

    server = socket.create_server(("127.0.0.1", 0))

    def swallow():
        while True:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            sockets.append(connection)  # accepted, and never answered
            was_asked.set()

    threading.Thread(target=swallow, daemon=True).start()
    silent = ModelSpec(provider="local", name="silent", base_url=f"http://127.0.0.1:{server.getsockname()[1]}/v1")
    seen = Simulated(speed=None)
    flight = FlightSpec(model=silent, simulated=seen, latency=LatencyPolicy.parse("fixed:0.5"), seconds=6.0, drones=1)
    batch = batch_of(tmp_path / "run", flight)

    class Impatient(LocalEngine):
        """Sets a short limit after the first request, because the start of a flight can also be silent for long."""

        def _turn(self, worker, fresh, flying):
            if was_asked.is_set():
                self._hang_s = 1.0
            super()._turn(worker, fresh, flying)

    results = fly(batch, flight, TWO[:1], engine=Impatient)
    server.close()
    assert results[TWO[0]].outcome == "error"
    assert re.search(r"\bhangs\b.*\b1 s", str(results[TWO[0]].error))
    assert batch.left(TWO[:1]) == [TWO[0]]
    assert not workers()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_no_worker_outlives_the_run(tmp_path, how):
    parent = audit(tmp_path / "run", "--jobs", "2")
    folder = tmp_path / "run"
    while not list(folder.glob("*/flight.tlog")):  # until a flight is in the air
        assert parent.poll() is None, parent.stderr.read()
    children = psutil.Process(parent.pid).children(recursive=True)
    assert children
    os.kill(parent.pid, how)
    _, errors = parent.communicate(timeout=60)
    _, alive = psutil.wait_procs(children, timeout=20)
    assert not alive
    if how == signal.SIGINT:
        assert parent.returncode == 130
        assert f"--out {folder}" in errors


def test_an_unwritable_run_folder_ends_the_run(tmp_path):
    batch = batch_of(tmp_path / "run", ORACLE)
    batch.fresh(EASY)
    (tmp_path / "run" / layout.UNFINISHED).write_text("a file where what was broken off has to be moved to")
    with pytest.raises(InfrastructureError, match=f"{tmp_path}/run"):
        fly(batch, ORACLE, [EASY])
    assert not workers()


def test_an_exception_in_the_engine_leaves_no_worker(tmp_path):

    class Mistaken(LocalEngine):
        def _turn(self, worker, fresh, flying):
            raise ZeroDivisionError

    batch = batch_of(tmp_path / "run", SHORT)
    with pytest.raises(ZeroDivisionError):
        fly(batch, SHORT, TWO[:1], engine=Mistaken)
    assert not workers()


def test_a_worker_that_cannot_be_started_ends_the_run(tmp_path, monkeypatch):
    batch = batch_of(tmp_path / "run", ORACLE)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no-python"))
    with pytest.raises(InfrastructureError, match=r"\bworker\b"):
        fly(batch, ORACLE, [EASY])


def test_an_engine_closed_during_a_start_leaves_no_worker(tmp_path):
    engine = LocalEngine(tmp_path / "log", jobs=2)
    batch = batch_of(tmp_path / "run", SHORT)
    for episode in TWO:
        record = batch.record(episode)
        engine.begin(Sortie(flight=dataclasses.replace(SHORT, record=record), folder=batch.fresh(episode)))
    assert workers()
    engine.close()
    assert not workers()


def test_invalid_audit_arguments_are_rejected_in_one_sentence(tmp_path, capsys):
    like = tmp_path / "like.json"
    like.write_text(dataclasses.replace(catalogue.load(EASY), instruction="go home").to_json())
    for arguments, sentence in (
        (["--pilot", "nobody"], "nobody"),
        (["no-such-episode"], "no-such-episode"),
        ([str(like)], "like.json: 'residential-approaching-01'"),
        ([str(like), EASY], f"'{EASY}'"),
        (["--suite", "quik"], "did you mean 'quick'"),
        (["--jobs", "0"], "--jobs"),
        (["--pilot", "vision", "--write-par"], "--write-par"),
    ):
        assert main(["episodes", "audit", "--json", "--out", str(tmp_path / "run"), *arguments]) == 2
        errors = capsys.readouterr().err
        assert sentence in errors
        assert len(errors.strip().splitlines()) == 1
