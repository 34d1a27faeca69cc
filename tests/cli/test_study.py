"""`dronecats study` as it is typed: what is refused, what a file says, and that a flight of it is flown again alone."""

import json
import os
import resource
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from dronecats.cli import sitting, study_spec
from dronecats.cli.main import main, parse
from dronecats.cli.study_options import levels
from dronecats.results.flown_run import flown_runs
from dronecats.rundir.reading import json_object
from dronecats.study import folder
from foundation.errors import UsageError
from tests.rundir.published import validator

TWO = "residential-approaching-01,campus-tracking-01"
HIERARCHICAL = "command=hierarchical"
LOGS = ("truth.jsonl", "decisions.jsonl", "verdict.json")
FILE = """
name = "wind and latency"
pilot = ["oracle", "blind:ring"]
cells = ["tracking", "approaching"]
maps = ["campus"]
flights = 2
seed = 7
seconds = 30
jobs = 2
limit = 3
design = "fractional"
generators = ["gusts = latency * wind"]

[factors]
latency = [0, 2]
wind = { low = 0, high = 6 }
gusts = [0, 3]

[held]
wind_towards = 90
payload = 0.2
"""


def study(name, *words):
    args = parse(["study", name, *words])
    if name == "run":
        return study_spec.of_file(args)
    return study_spec.of_options(args, name, {"latency": levels(args.values)})


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["latency", "--pilot", "oracle"], "say what is flown: --suite NAME, or episodes by id or file"),
        (["latency", "--cells", "tracking"], "nothing is to be flown: name a pilot with --model or --pilot"),
        (["latency", "--cells", "traking", "--pilot", "oracle"], "--cells wants some of approaching, searching"),
        (["latency", "--maps", "moon", "--pilot", "oracle"], "--maps wants some of blocks, campus, residential"),
        (
            ["latency", "--cells", "tracking", "--maps", "blocks", "--pilot", "oracle"],
            "no episode of all is tracking on",
        ),
        (["latency", "--cells", "tracking", "--episodes", TWO, "--pilot", "oracle"], "choose from a suite; leave them"),
        (["latency", "--episodes", TWO, "--pilot", "orakel"], "did you mean oracle"),
        (
            ["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "0,-1"],
            "latency wants a number from 0 to 300 s",
        ),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "0,soon"], "latency wants a number from"),
        (
            ["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "1,1.0"],
            "latency has one of its levels twice",
        ),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", ""], "latency wants a list of levels"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "wind"], "--hold wants FACTOR=LEVEL"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "wnd=3"], "did you mean wind"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "rate=3"], "rate and latency both say"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "pilot=oracle"], "leave --pilot out"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--seconds", "0"], "--seconds wants more than 0"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--flights", "0"], "--flights wants 1 to"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--shard", "3/2"], "--shard wants i/n"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--address", "h:1"], "--address goes with --engine ray"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--cost-limit", "1"], "--cost-limit goes with --model"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--commander", "scripted:divide"], "--hold command=hier"),
        (
            ["latency", "--episodes", TWO, "--pilot", "oracle", "--frame-drop", "0.1", "--hold", "frame_drop=0"],
            "or held",
        ),
        (["jitter", "--episodes", TWO, "--pilot", "oracle", "--rate", "30"], "rate wants a number from 0.01 to 20 Hz"),
        (
            ["jitter", "--episodes", TWO, "--pilot", "oracle", "--rho", "2"],
            "jitter_rho wants a number from -0.99 to 0.99",
        ),
        (
            ["jitter", "--episodes", TWO, "--pilot", "oracle", "--cv", "0", "--rho", "0.5"],
            "jitter_rho at 0.5 says nothing in every flight: jitter_cv is 0 there; give that a level above it",
        ),
        (
            ["latency", "--episodes", TWO, "--hold", "model=local/x", "--temperature", "0.5"],
            "--temperature is of one --model, and model is one of the factors, or held; leave it out",
        ),
        (
            ["latency", "--episodes", TWO, "--hold", "model=local/x", "--base-url", "http://h:1/v1"],
            "--base-url is of one --model",
        ),
        (
            ["latency", "--cells", "commanding", "--pilot", "oracle", "--hold", "agent=steady", "--hold", HIERARCHICAL],
            "command at hierarchical: agent steady goes with command flat or solo",
        ),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--seed", "-1"], "study: --seed wants a whole number"),
        (["run", "no-such.toml"], "no-such.toml cannot be read"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_sentence(words, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["study", *words, "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("flihgts = 2", "'flihgts' is not known; did you mean flights?"),
        ("desing = 'full'", "'desing' is not known; did you mean design?"),
        ("no_retry = true", "'no_retry' is not known"),
        ("latency = ['fixed:1']", "latency is a factor: say it under [factors], or under [held]"),
        ("cells = 'tracking'", "cells wants a list of words"),
        ("points = -1", "points wants a whole number"),
        ("name = 3", "name wants a word"),
        ("seconds = 'long'", "seconds wants a number"),
        ("design = 'random'", "design wants one of full, fractional, latin, one-at-a-time"),
        ("factors = 3", "factors wants a table"),
        ("", "a study wants factors: say what is varied under [factors]"),
        ("[factors]\nwint = [1, 2]", "did you mean wind"),
        (
            "[factors]\nwind = 3",
            "wind wants a list of levels, or { low = …, high = … }, got 3; one level goes under held",
        ),
        ("[factors]\nwind = { low = 5 }", "wind wants a list of levels, or"),
        ("[factors]\nwind = { low = 5, high = 2 }", "wind wants a low that is below its high"),
        ("[factors]\nagent = { low = 5, high = 2 }", "agent wants a list of levels, got"),
        ("[factors]\nwind = [1, 99]", "wind wants a number from 0 to 30 m/s, got 99"),
        ("design = 'latin'\n[factors]\nwind = [1, 2]", "wants points = N"),
        ("points = 3\n[factors]\nwind = [1, 2]", 'points goes with design = "latin"'),
        ("generators = ['D=AB']\n[factors]\nwind = [1, 2]", 'generators goes with design = "fractional"'),
        ("design = 'fractional'\n[factors]\nwind = [1, 2, 3]", "two levels of each factor; wind has 3"),
        ("[factors]\nwind = [1, 2]\n[held]\nwind = 1", "wind is varied and held at one level"),
        ("[factors]\nstall_share = [0, 0.1]", "stall_share goes with --speed N"),
        (
            "[factors]\nwind_towards = [0, 90]\n[held]\nwind = 0",
            "my.toml: wind_towards says nothing in every flight: wind is 0 there; give that a level above it",
        ),
        ("temperature = 0.5\n[factors]\nwind = [0, 9]", "--temperature goes with --model PROVIDER/NAME"),
        ("[factors]\nlatency_policy = ['fixed:1', 'real']", "my.toml: at latency_policy real: --latency real has no"),
        ("[factors]\npayload = [0, 20]", "my.toml: at payload 20: airframe 'x500' cannot carry 20 kg"),
        ("[factors]\nagent = ['paper', 'no:one']", "my.toml: at agent no:one: --agent no:one cannot be loaded"),
        ("speed = 1\n[factors]\nrate_cap = [0.1, 1]", "my.toml: at rate_cap 0.1: --latency real is what really"),
        ("suite = ", "is not TOML"),
    ],
)
def test_a_file_that_says_something_else_is_refused(text, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    who = "" if text.startswith("cells") else "cells = ['tracking']\n"
    Path("my.toml").write_text(f"pilot = 'oracle'\n{who}{text}")
    assert main(["study", "run", "my.toml"]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert len(said.strip().splitlines()) == 1
    assert not Path("runs").exists()


def test_a_file_says_what_is_flown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    asked = study("run", "my.toml")
    made = asked.plan.study
    assert (made.name, asked.out, asked.args.jobs, asked.args.limit) == ("wind and latency", Path("runs/my"), 2, 3)
    assert made.design == "fractional factorial 2^(3-1) of resolution III, C = AB"
    assert [(each.name, each.unit, each.levels) for each in made.factors] == [
        ("latency", "s", (0.0, 2.0)), ("wind", "m/s", (0.0, 6.0)), ("gusts", "m/s", (0.0, 3.0)),
    ]  # fmt: skip
    assert made.cells == ("approaching", "tracking")
    assert len(asked.plan.entries) == 2 * 4 * 2
    assert {entry.flight.seconds for entry in asked.plan.entries} == {30.0}
    assert {entry.flight.seed for entry in asked.plan.entries} == {7, 8}
    gale = next(e for e in asked.plan.entries if e.name == "oracle-latency-2-wind-6-gusts-3-f2").flight
    assert (gale.latency, gale.pilot, gale.seed) == ("fixed:2", "oracle", 8)
    vehicle = gale.disturbances.vehicle
    assert (vehicle.wind_ned, vehicle.gusts_w20, vehicle.payload_kg) == ((0.0, 6.0, 0.0), 3.0, 0.2)


def test_the_command_line_goes_before_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    asked = study("run", "my.toml", "--flights", "1", "--maps", "residential", "--out", "there", "--hold", "payload=0")
    assert asked.out == Path("there")
    assert {record.map for record in asked.suite.records.values()} == {"residential"}
    assert {record.cell for record in asked.suite.records.values()} == {"approaching", "tracking"}
    assert list(study("run", "my.toml", "--episodes", TWO).suite.records) == TWO.split(",")
    Path("named.toml").write_text("pilot = 'oracle'\nepisodes = ['campus-tracking-01']\n[factors]\nwind = [0, 1]")
    assert list(study("run", "named.toml").suite.records) == ["campus-tracking-01"]
    assert len(study("run", "named.toml", "--suite", "quick").suite.records) == 12
    assert asked.plan.study.held == {"wind_towards": 90.0, "payload": 0.0}
    assert asked.plan.study.flights == 1


def test_jitter_is_around_a_rate_that_is_held(tmp_path):
    args = parse(
        ["study", "jitter", "--rate", "4", "--cv", "0,1", "--rho", "0.5", "--cells", "tracking", "--pilot", "oracle"]
    )
    held = {"rate": args.rate, "jitter_rho": args.rho}
    made = study_spec.of_options(args, "jitter", {"jitter_cv": levels(args.cv)}, held)
    assert {entry.flight.latency for entry in made.plan.entries} == {"jitter:4,0,0.5", "jitter:4,1,0.5"}


def test_a_pilot_may_be_a_factor():
    asked = study("latency", "--values", "0,1", "--episodes", TWO, "--hold", "pilot=vision")
    assert [entry.name for entry in asked.plan.entries] == ["latency-0-f1", "latency-1-f1"]
    assert all(e.flight.pilot == "vision" and e.flight.simulated.rendered for e in asked.plan.entries)


def dronecats(*words, cwd):
    command = [sys.executable, "-m", "dronecats.cli.main", *words]
    path = os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        command,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )


def finished(process):
    """Return (status, what it said, what it complained about) of a command that is over."""
    out, errors = process.communicate(timeout=900)
    return process.returncode, out, errors


def logs_of(episode):
    return {name: (episode / name).read_bytes() for name in LOGS}


SMALL = ["study", "latency", "--values", "0,2", "--episodes", TWO, "--pilot", "oracle", "--seconds", "10", "--full"]


@pytest.mark.slow
def test_a_study_is_flown_into_its_folder_and_any_flight_of_it_again_alone(tmp_path, monkeypatch, capsys):
    words = [*SMALL, "--limit", "1", "--out", "s"]
    status, said, errors = finished(dronecats(*words, "--jobs", "1", "--json", cwd=tmp_path))
    assert status == 0, errors
    out = tmp_path / "s"
    value = json_object(out / "study.json")
    assert value is not None
    validator("study").validate(value)
    runs = {"oracle-latency-0-f1", "oracle-latency-2-f1"}
    assert {run.name for run in folder.read(out).runs} == {run.folder.name for run in flown_runs([out])} == runs
    told = json.loads(said.splitlines()[-1])
    assert (told["study"], told["episodes"], told["done"], set(told["again"])) == ("latency", 2, 2, runs)
    command = shlex.split(told["again"]["oracle-latency-2-f1"])
    assert command[0] == "dronecats"
    status, _, errors = finished(dronecats(*command[1:], cwd=tmp_path))
    assert status == 0, errors
    (first,) = (each for each in (tmp_path / "again" / "oracle-latency-2-f1").iterdir() if each.is_dir())
    assert logs_of(first) == logs_of(out / "oracle-latency-2-f1" / first.name)
    assert logs_of(first) != logs_of(out / "oracle-latency-0-f1" / first.name)
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0  # and flies nothing more
    said, errors = capsys.readouterr()
    assert "2/2" in errors
    assert f"  {shlex.join(command)}" in said.splitlines()
    assert main([*words, "--values", "0,1"]) == 2
    errors = capsys.readouterr().err
    differs = "factors, latency 0, 2 there and latency 0, 1 now"
    assert errors == f"dronecats study: s is of another study (not the same: {differs}); choose another --out\n"


def test_a_process_may_hold_a_lock_for_each_run():
    before, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (sitting.FILES, hard))
        sitting.allow_locks(3)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (sitting.FILES + 3, hard)
        sitting.allow_locks(1)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (sitting.FILES + 3, hard)
        if hard != resource.RLIM_INFINITY:
            with pytest.raises(UsageError, match="open files, and the system allows"):
                sitting.allow_locks(hard)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (before, hard))


@pytest.mark.slow
def test_a_study_that_is_killed_ends_with_the_same_bytes(tmp_path):
    status, _, errors = finished(dronecats(*SMALL, "--jobs", "1", "--out", "whole", cwd=tmp_path))
    assert status == 0, errors
    process = dronecats(*SMALL, "--jobs", "1", "--out", "torn", cwd=tmp_path)
    out = tmp_path / "torn"
    while process.poll() is None and len(list(out.glob("*/*/verdict.json"))) < 1:
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGKILL)
    finished(process)
    _, alive = psutil.wait_procs(children, timeout=20)
    assert not alive
    before = {str(each.relative_to(out)): each.read_bytes() for each in out.glob("*/*/verdict.json")}
    assert 0 < len(before) < 4
    status, _, errors = finished(dronecats(*SMALL, "--jobs", "1", "--out", "torn", cwd=tmp_path))
    assert status == 0, errors
    for episode in (tmp_path / "whole").glob("*/*/"):
        if (episode / "verdict.json").exists():
            assert logs_of(episode) == logs_of(out / episode.relative_to(tmp_path / "whole"))
    assert (out / "study.json").read_bytes() == (tmp_path / "whole" / "study.json").read_bytes()
    assert all((out / name).read_bytes() == data for name, data in before.items())


@pytest.mark.slow
@pytest.mark.xdist_group("ray")  # two clusters at once are two too many for two cores
def test_a_study_on_a_cluster_has_the_same_bytes(tmp_path):
    for out, more in (("here", []), ("there", ["--engine", "ray"])):
        status, _, errors = finished(dronecats(*SMALL, "--jobs", "2", "--out", out, *more, cwd=tmp_path))
        assert status == 0, errors
    flown = [each.parent.relative_to(tmp_path / "here") for each in (tmp_path / "here").glob("*/*/verdict.json")]
    assert len(flown) == 4
    for episode in flown:
        assert logs_of(tmp_path / "here" / episode) == logs_of(tmp_path / "there" / episode)
    assert (tmp_path / "here" / "study.json").read_bytes() == (tmp_path / "there" / "study.json").read_bytes()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[factors]\nlatency = [0, 1]\n[held]\nlink_loss = 0.1\n'link-loss' = 0.2\n", r"\[held\] says link_loss twice"),
        ("[factors]\nlink_loss = [0.1]\n'link-loss' = [0.2]\n", r"\[factors\] says link_loss twice"),
        ("[factors]\nwind_towards = [0, 90]\n", "wind_towards at 0: it goes with wind"),
    ],
)
def test_a_factor_is_said_once_and_beside_what_it_refines(tmp_path, text, sentence):
    (tmp_path / "s.toml").write_text(f'pilot = ["noisy"]\ncells = ["tracking"]\n{text}')
    with pytest.raises(UsageError, match=sentence):
        study("run", str(tmp_path / "s.toml"))
