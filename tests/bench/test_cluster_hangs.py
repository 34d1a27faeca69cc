"""The cluster's engine kills a worker with a flight that hangs. Ray is replaced by calls in this process."""

import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import ray

from dronecats.bench import cluster, worker
from dronecats.bench import engine as local
from dronecats.bench.cluster import ClusterEngine, ClusterWorker
from dronecats.bench.engine import Sortie
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated

FLIGHT = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))


@pytest.fixture
def actor():
    """A worker, whose flights wait for `release`."""
    return ClusterWorker()


@pytest.fixture
def folders():
    """The folders in which the worker flies, in the order of the flights."""
    return list[Path]()


@pytest.fixture
def killed():
    """The handles of the workers that the engine has killed."""
    return []


@pytest.fixture
def clock(monkeypatch):
    """The clock of the engine. Only the test advances it."""
    made = SimpleNamespace(now_s=0.0)
    made.monotonic = lambda: made.now_s
    monkeypatch.setattr(local, "time", made)
    return made


@pytest.fixture
def engine(actor, folders, killed, clock, monkeypatch):
    """An engine with one worker in this process. Its flights never end."""
    made = object.__new__(ClusterEngine)
    made._ledger, made._flying, made._most = None, {}, 1
    over, threads = threading.Event(), list[threading.Thread]()

    def fly(flight, folder):
        folders.append(folder)
        over.wait(60.0)
        return {}

    def remote(*arguments):
        threads.append(threading.Thread(target=actor.fly, args=arguments))
        threads[-1].start()
        return len(threads)

    look = SimpleNamespace(remote=actor.written)
    handle = SimpleNamespace(
        fly=SimpleNamespace(remote=remote), written=SimpleNamespace(options=lambda concurrency_group: look)
    )
    made._workers = [cluster._Actor(handle)]
    monkeypatch.setattr(worker, "fly_flight", fly)
    monkeypatch.setattr(cluster, "HANG_S", 100.0)
    monkeypatch.setattr(ray, "get", lambda reference, timeout: reference)
    monkeypatch.setattr(ray, "kill", killed.append)
    yield made
    over.set()
    for thread in threads:
        thread.join()


def begin(engine, folders, tmp_path):
    """Begin two flights of one episode, in two runs."""
    for count, run in enumerate(("run1", "run2"), 1):
        engine.begin(Sortie(flight=FLIGHT, folder=tmp_path / run / "residential-approaching-01"))
        while len(folders) < count:
            time.sleep(0.01)


def check_twice(engine, clock, growing):
    """Check the worker twice, and let a log grow in between, for longer than a flight may be silent."""
    engine._look()
    clock.now_s += 101.0
    with (growing / "truth.jsonl").open("a") as log:
        log.write("{}\n")
    engine._look()


def test_a_flight_that_has_not_begun_does_not_kill_its_worker(engine, clock, folders, killed, tmp_path):
    begin(engine, folders, tmp_path)
    check_twice(engine, clock, folders[0])
    assert killed == []


@pytest.mark.parametrize("silent", [0, 1])
def test_flights_of_one_episode_are_checked_separately(engine, clock, folders, killed, tmp_path, silent):
    begin(engine, folders, tmp_path)
    (folders[silent] / "episode.json").write_text("{}")
    check_twice(engine, clock, folders[1 - silent])
    assert killed == [engine._workers[0].handle]
