"""A real Ray cluster of two nodes on this machine. It writes the same bytes as a local run."""

import dataclasses
import os
import signal
import time

import psutil
import pytest
import ray
from ray.cluster_utils import Cluster

from dronecats.agent.models.ledger import Ledger, Spent
from dronecats.bench import cluster as bench_cluster
from dronecats.bench.campaign import Batch, Campaign, EndedFlight, OpenRun
from dronecats.bench.cluster import ClusterEngine, ClusterWorker
from dronecats.bench.engine import LocalEngine, Sortie
from dronecats.bench.matrix import BenchEntry
from dronecats.flight.run.accounts import RemoteLedger
from dronecats.flight.run.identity import code_digest
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_redacted_json
from foundation.errors import UsageError

# Two clusters at once are too many for two cores.
pytestmark = [pytest.mark.slow("starts a Ray cluster of two nodes"), pytest.mark.xdist_group("ray")]

FLIGHT = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False), seconds=20.0, full=True)
FOUR = ("residential-approaching-01", "residential-tracking-01", "campus-searching-01", "blocks-commanding-01")
LONG = dataclasses.replace(FLIGHT, seconds=300.0)


@pytest.fixture
def cluster(monkeypatch):
    """Two nodes of one core each. The second can be removed."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")]))
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    nodes.add_node(num_cpus=1)
    nodes.wait_for_nodes()
    yield nodes
    ray.shutdown()
    nodes.shutdown()


def fly(run, engine, flight=FLIGHT, episodes=FOUR, on_came=lambda came: None):
    batch = Batch(run, {"flight": as_redacted_json(flight)})
    entry = BenchEntry(name="run", flight=flight, episodes=tuple(episodes))
    campaign = Campaign([OpenRun(entry=entry, batch=batch, part=entry.episodes)], jobs=4, retry=False)
    came: list[EndedFlight] = []

    def take(each):
        came.append(each)
        on_came(each)

    try:
        campaign.fly(engine, take)
    finally:
        batch.close()
    return {each.result.episode: each.result for each in came}


def logs(run, episode):
    return {name: (run / episode / name).read_bytes() for name in ("truth.jsonl", "decisions.jsonl", "verdict.json")}


def flying():
    """Return the worker processes of this test's cluster."""
    own = {process.pid for process in psutil.Process().children(recursive=True)}
    named = [p for p in psutil.process_iter(["cmdline"]) if p.pid in own and p.info["cmdline"]]
    return [p for p in named if p.info["cmdline"][0].startswith("ray::ClusterWorker")]


def test_a_cluster_writes_the_same_bytes_as_a_local_run(cluster, tmp_path):
    here = fly(tmp_path / "here", LocalEngine(tmp_path / "worker.log", 2))
    there = fly(tmp_path / "there", ClusterEngine(4, None, cluster.address))
    assert {name: each.outcome for name, each in here.items()} == {name: each.outcome for name, each in there.items()}
    for episode in FOUR:
        assert logs(tmp_path / "here", episode) == logs(tmp_path / "there", episode)
    assert sorted(p.name for p in (tmp_path / "here" / FOUR[0]).iterdir()) == sorted(
        p.name for p in (tmp_path / "there" / FOUR[0]).iterdir()
    )
    _, alive = psutil.wait_procs(flying(), timeout=20)  # Ray ends its workers by itself, after the run is over
    assert not alive


def test_a_killed_worker_loses_only_its_flights_in_the_air(cluster, tmp_path):
    killed: list[int] = []

    def kill_one(came):
        if not killed:
            victim = next(p for p in flying() if p.status() != psutil.STATUS_ZOMBIE)
            killed.append(victim.pid)
            os.kill(victim.pid, signal.SIGKILL)

    engine = ClusterEngine(4, None, cluster.address)
    first = fly(tmp_path / "run", engine, LONG, on_came=kill_one)
    assert killed
    assert set(first) == set(FOUR)
    broken = {name for name, each in first.items() if each.outcome == "error"}
    assert 0 < len(broken) < len(FOUR)
    assert {each.outcome for each in first.values()} <= {"error", "success", "failure"}
    assert all("worker" in str(first[name].error) for name in broken)
    again = fly(tmp_path / "run", ClusterEngine(4, None, cluster.address), LONG)
    assert set(again) == broken
    assert all(each.outcome in ("success", "failure") for each in again.values())


def test_a_removed_node_loses_only_its_flights_in_the_air(cluster, tmp_path):
    gone: list[bool] = []

    def take_it_away(came):
        if not gone:
            gone.append(True)
            (node,) = cluster.list_all_nodes()[1:]
            cluster.remove_node(node, allow_graceful=False)

    first = fly(tmp_path / "run", ClusterEngine(4, None, cluster.address), LONG, on_came=take_it_away)
    assert set(first) == set(FOUR)
    broken = {name for name, each in first.items() if each.outcome == "error"}
    again = fly(tmp_path / "run", ClusterEngine(4, None, cluster.address), LONG)
    assert set(again) == broken
    assert all(each.outcome in ("success", "failure") for each in again.values())


class BusyWorker(ClusterWorker):
    """A worker whose flights never end."""

    def ready(self):
        return code_digest()

    def fly(self, flight, name, key):
        time.sleep(600.0)


def test_a_worker_answers_while_all_its_flights_are_in_the_air(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_cluster, "ClusterWorker", BusyWorker)
    monkeypatch.setattr(bench_cluster, "FLIGHTS_MAX", 1)
    monkeypatch.setattr(bench_cluster, "ANSWER_S", 60.0)
    engine = ClusterEngine(1, None)
    engine.begin(Sortie(flight=FLIGHT, folder=tmp_path / "e"))
    engine._look()
    assert not ray.wait(list(engine._flying), timeout=2.0)[0]  # the worker has not been killed
    engine.close()


def test_one_ledger_and_one_limiter_serve_the_whole_cluster(cluster, tmp_path):
    engine = ClusterEngine(1, tmp_path / "ledger.sqlite", cluster.address)
    assert engine._ledger is not None

    @ray.remote(num_cpus=1, scheduling_strategy="SPREAD")
    def book(name):
        books = RemoteLedger(name)
        limiter = books.limiter("https://vendor.example", "m")
        for _ in range(10):
            books.spend("openai/m", Spent(1, 100, 10, 0.01))
        limiter.hold(600.0)
        return limiter.claim(10)

    waits = ray.get([book.remote(engine._ledger) for _ in range(4)])
    assert all(wait_s > 0.0 for wait_s in waits)  # the hold of one worker applies to all
    engine.close()
    ledger = Ledger(tmp_path / "ledger.sqlite")
    spent = ledger.spent()
    assert (spent.questions, spent.tokens, round(spent.usd, 6)) == (40, 4400, 0.4)
    ledger.close()


def test_the_error_for_an_unreachable_cluster_names_its_address(tmp_path):
    with pytest.raises(UsageError, match=r"127.0.0.1:1"):
        ClusterEngine(1, None, "127.0.0.1:1")
