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
from dronecats.campaign.runner import Runner
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


@pytest.mark.slow
def test_a_killed_worker_costs_its_episode_and_no_other(tmp_path):
    episodes = [EASY, "residential-searching-01", "residential-tracking-01"]
    batch, killed = Batch(tmp_path / "run", SETTINGS), []

    class Fragile(Runner):
        """Its second episode's worker dies when it has just been told to fly."""

        def _one(self, worker, episode):
            if episode == episodes[1]:
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)
            return super()._one(worker, episode)

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
