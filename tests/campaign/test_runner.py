"""Workers are real processes: they fly, they are killed, and what was left is flown by the next run."""

import dataclasses
import json
import os
import signal
import subprocess
import sys

import psutil
import pytest

from dronecats.campaign.batch import UNFINISHED, Batch
from dronecats.campaign.runner import Runner, shares
from dronecats.flight.file import as_kept
from dronecats.flight.spec import FlightSpec, Simulated
from episodes import catalogue
from foundation.errors import InfrastructureError

ORACLE = FlightSpec(pilot="oracle", simulated=Simulated(speed=None, rendered=False))
SETTINGS = {"flight": as_kept(ORACLE)}
EASY = "residential-approaching-01"


def audit(out, *arguments):
    command = [sys.executable, "-m", "dronecats.cli.main", "episodes", "audit", "--json", "--out", str(out), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_oracle_solves_an_episode_and_it_is_not_flown_twice(tmp_path):
    first = audit(tmp_path / "run", EASY)
    out, errors = first.communicate(timeout=600)
    assert first.returncode == 0, errors
    report = json.loads(out.splitlines()[-1])
    assert report["unsolved"] == {}
    assert report["rows"][-1]["solved"] == report["rows"][-1]["flown"] == 1
    log = tmp_path / "run" / EASY / "decisions.jsonl"
    flown = log.stat().st_mtime_ns
    file = tmp_path / "mine.json"
    file.write_text(catalogue.load(EASY).to_json())
    again = audit(tmp_path / "run", str(file))
    assert json.loads(again.communicate(timeout=600)[0].splitlines()[-1])["rows"] == report["rows"]
    assert log.stat().st_mtime_ns == flown


def workers():
    """Return this process's children that fly, or start to."""
    return [p for p in psutil.Process().children(recursive=True) if "dronecats.processes.child" in p.cmdline()]


def flown_bytes(folder):
    return {name: (folder / name).read_bytes() for name in ("truth.jsonl", "decisions.jsonl", "verdict.json")}


def test_flights_that_share_a_worker_are_those_flown_alone(tmp_path, monkeypatch):
    """Whatever a process keeps for all of its flights must not move one of them."""
    monkeypatch.setattr("dronecats.campaign.runner.cores", lambda: 1)
    seen = FlightSpec(pilot="vision", simulated=Simulated(speed=None), latency="fixed:0.1", seconds=6.0, full=True)
    # one map twice, a fleet, and a target that moves
    episodes = [EASY, "residential-tracking-01", "blocks-commanding-01"]
    together, alone = (Batch(tmp_path / name, {"flight": as_kept(seen)}) for name in ("together", "alone"))
    in_flight = []

    class Watched(Runner):
        def _begin(self, worker, episode, flying):
            super()._begin(worker, episode, flying)
            in_flight.append((worker.pid, len(flying)))

    Watched(together, seen, jobs=3).fly(episodes)
    assert [count for _, count in in_flight] == [1, 2, 3]
    assert len({pid for pid, _ in in_flight}) == 1
    Runner(alone, seen, jobs=1).fly(episodes)
    for episode in episodes:
        assert flown_bytes(together.folder(episode)) == flown_bytes(alone.folder(episode))


@pytest.mark.parametrize(
    ("jobs", "on", "expected"), [(1, 2, [1]), (2, 2, [1, 1]), (16, 2, [8, 8]), (5, 2, [3, 2]), (3, 8, [1, 1, 1])]
)
def test_flights_are_shared_out_evenly(jobs, on, expected):
    assert shares(jobs, on) == expected


def test_a_flight_that_cannot_be_looked_up_costs_itself_alone(tmp_path):
    """The others of its worker fly on, since nothing has died."""
    batch = Batch(tmp_path / "run", SETTINGS)

    class Mistold(Runner):
        def _begin(self, worker, episode, flying):
            if episode == "residential-searching-01":
                batch._records[episode] = dataclasses.replace(batch._record(episode), map="nowhere")
            super()._begin(worker, episode, flying)

    results = {r.episode: r for r in Mistold(batch, ORACLE, jobs=2).fly([EASY, "residential-searching-01"])}
    assert results[EASY].outcome == "success"
    assert results["residential-searching-01"].outcome == "error"
    assert "nowhere" in str(results["residential-searching-01"].error)


@pytest.mark.slow
def test_a_killed_worker_costs_its_episode_and_no_other(tmp_path):
    episodes = [EASY, "residential-searching-01", "residential-tracking-01"]
    batch, killed = Batch(tmp_path / "run", SETTINGS), []

    class Fragile(Runner):
        """Its second episode's worker dies when it has just been told to fly."""

        def _begin(self, worker, episode, flying):
            if episode == episodes[1]:
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)
            super()._begin(worker, episode, flying)

    outcomes = {r.episode: r.outcome for r in Fragile(batch, ORACLE, jobs=1).fly(episodes)}
    assert len(killed) == 1
    assert outcomes == {episodes[0]: "success", episodes[1]: "error", episodes[2]: "success"}
    assert batch.left(episodes) == [episodes[1]]
    again = Runner(batch, ORACLE, jobs=2).fly(batch.left(episodes))
    assert [r.outcome for r in again] == ["success"]
    assert not workers()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_no_worker_outlives_the_run(tmp_path, how):
    parent = audit(tmp_path / "run", "--jobs", "2")
    folder = tmp_path / "run"
    while not list(folder.glob("*/flight.tlog")):  # until something is in the air
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


def test_a_run_folder_that_takes_nothing_ends_the_run(tmp_path):
    batch = Batch(tmp_path / "run", SETTINGS)
    batch.fresh(EASY)
    (tmp_path / "run" / UNFINISHED).write_text("a file where what was broken off has to be moved to")
    with pytest.raises(InfrastructureError, match="cannot be written: File exists"):
        Runner(batch, ORACLE, jobs=1).fly([EASY])
    assert not workers()


def test_a_worker_that_starts_after_the_end_ends_too(tmp_path):
    runner = Runner(Batch(tmp_path / "run", SETTINGS), ORACLE, jobs=1)
    runner._close()
    with pytest.raises(InfrastructureError, match="killed by SIGKILL"):
        runner._start()
    assert not workers()


def test_what_cannot_be_flown_is_refused_at_once(tmp_path):
    like = tmp_path / "like.json"
    like.write_text(dataclasses.replace(catalogue.load(EASY), instruction="go home").to_json())
    for arguments, sentence in (
        (["--pilot", "nobody"], "nobody"),
        (["no-such-episode"], "no-such-episode"),
        ([str(like)], "like.json: 'residential-approaching-01' is the id of an episode that ships"),
        ([str(like), EASY], "two of the episodes have the id"),
        (["--suite", "quik"], "did you mean quick"),
        (["--jobs", "0"], "--jobs"),
        (["--pilot", "vision", "--write-par"], "--write-par"),
    ):
        refused = audit(tmp_path / "run", *arguments)
        _, errors = refused.communicate(timeout=60)
        assert refused.returncode == 2
        assert sentence in errors
        assert len(errors.strip().splitlines()) == 1
