"""The cluster's engine kills a worker with a flight that hangs. Ray is replaced by calls in this process."""

import threading
import time
from types import SimpleNamespace

import pytest

from dronecats.bench import cluster, worker
from dronecats.bench.cluster import ClusterEngine, ClusterWorker
from dronecats.bench.engine import Sortie
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated

FLIGHT = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))


@pytest.fixture
def actor():
    """A worker, whose flights wait for `release`."""
    return ClusterWorker()


@pytest.fixture
def engine(actor, monkeypatch):
    """An engine with one worker in this process. `killed` has the handles of killed workers."""
    made = object.__new__(ClusterEngine)
    made._ledger, made._flying, made._most, made.killed = None, {}, 1, []
    over, threads = threading.Event(), []

    def fly(flight, folder):
        folders.append(folder)
        over.wait(60.0)
        return {}

    def remote(*arguments):
        threads.append(threading.Thread(target=actor.fly, args=arguments))
        threads[-1].start()
        return len(threads)

    folders = made.folders = []
    look = SimpleNamespace(remote=actor.written)
    handle = SimpleNamespace(
        fly=SimpleNamespace(remote=remote), written=SimpleNamespace(options=lambda concurrency_group: look)
    )
    made._workers = [cluster._Actor(handle)]
    monkeypatch.setattr(worker, "fly_flight", fly)
    monkeypatch.setattr(cluster, "HANG_S", 0.2)
    monkeypatch.setattr(cluster.ray, "get", lambda reference, timeout: reference)
    monkeypatch.setattr(cluster.ray, "kill", made.killed.append)
    yield made
    over.set()
    for thread in threads:
        thread.join()


def begin(engine, tmp_path, *runs):
    """Begin a flight of one episode for each run, and return the folders in which the worker flies, in their order."""
    for count, run in enumerate(runs, 1):
        engine.begin(Sortie(flight=FLIGHT, folder=tmp_path / run / "residential-approaching-01"))
        while len(engine.folders) < count:
            time.sleep(0.01)
    return engine.folders


def check_twice(engine, growing):
    """Check the worker twice, and let a log grow in between, for longer than a flight may be silent."""
    engine._look()
    time.sleep(0.4)
    with (growing / "truth.jsonl").open("a") as log:
        log.write("{}\n")
    engine._look()


def test_a_flight_that_has_not_begun_does_not_kill_its_worker(engine, tmp_path):
    growing, _ = begin(engine, tmp_path, "run1", "run2")
    check_twice(engine, growing)
    assert engine.killed == []


@pytest.mark.parametrize("silent", [0, 1])
def test_flights_of_one_episode_are_checked_separately(engine, tmp_path, silent):
    folders = begin(engine, tmp_path, "run1", "run2")
    (folders[silent] / "episode.json").write_text("{}")
    check_twice(engine, folders[1 - silent])
    assert engine.killed == [engine._workers[0].handle]
