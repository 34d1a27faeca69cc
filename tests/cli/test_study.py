"""The command `dronecats study`: rejected arguments, study files, and repeats of single flights of a study."""

import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import ModelSpec
from dronecats.cli import campaign, study_spec
from dronecats.cli.main import main, parse
from dronecats.cli.options import level_list as levels
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.report.recorded.run import recorded_runs
from dronecats.study import folder
from foundation.errors import UsageError
from foundation.run_folder.reading import json_object
from tests.foundation.run_folder.published import validator

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


def test_a_queue_goes_with_a_varied_baud(tmp_path):
    words = ("--episodes", TWO, "--pilot", "oracle", "--link", "queue=4096")
    with pytest.raises(UsageError, match=r"queue .*baud"):
        study("latency", *words)
    file = tmp_path / "baud.toml"
    file.write_text("[factors]\nlink_baud = [9600, 57600]\n")
    for entry in study("run", str(file), *words).plan.entries:
        assert entry.flight.disturbances.link.to_vehicle.queue_bytes == 4096


def test_invalid_arguments_are_rejected_in_one_sentence(capsys, tmp_path, monkeypatch):
    for words, parts in (
        (["latency", "--pilot", "oracle"], "--suite"),
        (["latency", "--cells", "tracking"], "--model .*--pilot"),
        (["latency", "--cells", "traking", "--pilot", "oracle"], "--cells .*approaching, searching"),
        (["latency", "--maps", "moon", "--pilot", "oracle"], "--maps .*blocks, campus, residential"),
        (["latency", "--cells", "tracking", "--maps", "blocks", "--pilot", "oracle"], "tracking .*blocks"),
        (["latency", "--cells", "tracking", "--episodes", TWO, "--pilot", "oracle"], "--cells"),
        (["latency", "--episodes", TWO, "--pilot", "orakel"], "orakel.*oracle"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "0,-1"], "latency .*0 .*300 s.*-1"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "0,soon"], "latency .*'soon'"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", "1,1.0"], "latency .*twice"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--values", ""], "latency "),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "wind"], "--hold .*FACTOR=LEVEL"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "wnd=3"], "wnd.*wind"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "rate=3"], "rate .*latency "),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--hold", "pilot=oracle"], "--pilot"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--seconds", "0"], "--seconds .*0"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--flights", "0"], "--flights .*1 .*0"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--shard", "3/2"], "--shard .*3/2"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--address", "h:1"], "--address .*--engine ray"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--cost-limit", "1"], "--cost-limit .*--model"),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--commander", "scripted:divide"], "--hold command=hier"),
        (
            ["latency", "--episodes", TWO, "--pilot", "oracle", "--frame-drop", "0.1", "--hold", "frame_drop=0"],
            "--frame-drop",
        ),
        (["jitter", "--episodes", TWO, "--pilot", "oracle", "--rate", "30"], "rate .*0.01 .*20 Hz"),
        (["jitter", "--episodes", TWO, "--pilot", "oracle", "--rho", "2"], "jitter_rho .*-0.99 .*0.99"),
        (
            ["jitter", "--episodes", TWO, "--pilot", "oracle", "--cv", "0", "--rho", "0.5"],
            "jitter_rho .*0.5 .*jitter_cv .*0 ",
        ),
        (["latency", "--episodes", TWO, "--hold", "model=local/x", "--temperature", "0.5"], "--temperature .*--model"),
        (
            ["latency", "--episodes", TWO, "--hold", "model=local/x", "--base-url", "http://h:1/v1"],
            "--base-url .*--model",
        ),
        (
            ["latency", "--cells", "commanding", "--pilot", "oracle", "--hold", "agent=steady", "--hold", HIERARCHICAL],
            "command .*hierarchical: --agent steady .*flat .*solo",
        ),
        (["latency", "--episodes", TWO, "--pilot", "oracle", "--seed", "-1"], "study: --seed .*-1"),
        (["run", "no-such.toml"], "no-such.toml"),
    ):
        monkeypatch.chdir(tmp_path)
        assert main(["study", *words, "--out", "out"]) == 2, words
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert len(error.strip().splitlines()) == 1, words
        assert not (tmp_path / "out").exists(), words


def test_invalid_files_are_rejected(tmp_path, monkeypatch, capsys):
    for text, parts in (
        ("flihgts = 2", "'flihgts' .*flights"),
        ("desing = 'full'", "'desing' .*design"),
        ("no_retry = true", "'no_retry'"),
        ("latency = ['fixed:1']", r"latency .*\[factors\].*\[held\]"),
        ("cells = 'tracking'", "'cells' "),
        ("points = -1", "'points' .*-1"),
        ("name = 3", "'name' "),
        ("seconds = 'long'", "'seconds' "),
        ("design = 'random'", "'design' .*full, fractional, latin, one-at-a-time"),
        ("factors = 3", "'factors' "),
        ("", r"\[factors\]"),
        ("[factors]\nwint = [1, 2]", "wint.*wind"),
        ("[factors]\nwind = 3", "wind .*{ low = …, high = … }.*3.*held"),
        ("[factors]\nwind = { low = 5 }", "wind .*high"),
        ("[factors]\nwind = { low = 5, high = 2 }", "wind .*low .*high"),
        ("[factors]\nagent = { low = 5, high = 2 }", "agent "),
        ("[factors]\nwind = [1, 99]", "wind .*0 .*30 m/s.*99"),
        ("design = 'latin'\n[factors]\nwind = [1, 2]", "points = N"),
        ("points = 3\n[factors]\nwind = [1, 2]", 'points .*design = "latin"'),
        ("generators = ['D=AB']\n[factors]\nwind = [1, 2]", 'generators .*design = "fractional"'),
        ("design = 'fractional'\n[factors]\nwind = [1, 2, 3]", "wind .*3"),
        ("[factors]\nwind = [1, 2]\n[held]\nwind = 1", "wind .*held"),
        ("[factors]\nstall_share = [0, 0.1]", "stall_share .*--speed"),
        ("[factors]\nwind_towards = [0, 90]\n[held]\nwind = 0", "my.toml: wind_towards .*wind .*0 "),
        ("temperature = 0.5\n[factors]\nwind = [0, 9]", "--temperature .*--model"),
        ("[factors]\nlatency_policy = ['fixed:1', 'real']", "my.toml: .*latency_policy at real: --latency real "),
        ("[factors]\npayload = [0, 20]", "my.toml: .*payload 20: .*'x500' .*20 kg"),
        ("[factors]\nagent = ['paper', 'no:one']", "my.toml: .*agent no:one: --agent no:one "),
        ("speed = 1\n[factors]\nrate_cap = [0.1, 1]", "my.toml: .*rate_cap at 0.1: --latency real "),
        ("suite = ", "my.toml"),
    ):
        monkeypatch.chdir(tmp_path)
        cells = "" if text.startswith("cells") else "cells = ['tracking']\n"
        Path("my.toml").write_text(f"pilot = 'oracle'\n{cells}{text}")
        assert main(["study", "run", "my.toml"]) == 2, text
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert len(error.strip().splitlines()) == 1, text
        assert not Path("runs").exists(), text


def test_a_study_file_sets_the_plan(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    campaign_spec = study("run", "my.toml")
    made = campaign_spec.plan.study
    assert (made.name, campaign_spec.out, campaign_spec.args.jobs, campaign_spec.args.limit) == (
        "wind and latency",
        Path("runs/my"),
        2,
        3,
    )
    assert re.search(r"fractional .*2\^\(3-1\).* III, C = AB", made.design)
    assert [(factor.name, factor.unit, factor.levels) for factor in made.factors] == [
        ("latency", "s", (0.0, 2.0)), ("wind", "m/s", (0.0, 6.0)), ("gusts", "m/s", (0.0, 3.0)),
    ]  # fmt: skip
    assert made.cells == ("approaching", "tracking")
    assert len(campaign_spec.plan.entries) == 2 * 4 * 2
    assert {entry.flight.seconds for entry in campaign_spec.plan.entries} == {30.0}
    assert {entry.flight.seed for entry in campaign_spec.plan.entries} == {7, 8}
    gale = next(e for e in campaign_spec.plan.entries if e.name == "oracle-latency-2-wind-6-gusts-3-f2").flight
    assert (str(gale.latency), gale.pilot, gale.seed) == ("fixed:2", "oracle", 8)
    vehicle = gale.disturbances.vehicle
    assert (vehicle.wind_ned, vehicle.gusts_w20, vehicle.payload_kg) == ((0.0, 6.0, 0.0), 3.0, 0.2)


def test_the_command_line_goes_before_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    campaign_spec = study(
        "run", "my.toml", "--flights", "1", "--maps", "residential", "--out", "there", "--hold", "payload=0"
    )
    assert campaign_spec.out == Path("there")
    assert {record.map for record in campaign_spec.suite.records.values()} == {"residential"}
    assert {record.cell for record in campaign_spec.suite.records.values()} == {"approaching", "tracking"}
    assert list(study("run", "my.toml", "--episodes", TWO).suite.records) == TWO.split(",")
    Path("named.toml").write_text("pilot = 'oracle'\nepisodes = ['campus-tracking-01']\n[factors]\nwind = [0, 1]")
    assert list(study("run", "named.toml").suite.records) == ["campus-tracking-01"]
    assert len(study("run", "named.toml", "--suite", "quick").suite.records) == 12
    assert campaign_spec.plan.study.held == {"wind_towards": 90.0, "payload": 0.0}
    assert campaign_spec.plan.study.flights == 1


def test_study_jitter_holds_the_rate(tmp_path):
    args = parse(
        ["study", "jitter", "--rate", "4", "--cv", "0,1", "--rho", "0.5", "--cells", "tracking", "--pilot", "oracle"]
    )
    held = {"rate": args.rate, "jitter_rho": args.rho}
    made = study_spec.of_options(args, "jitter", {"jitter_cv": levels(args.cv)}, held)
    assert {str(entry.flight.latency) for entry in made.plan.entries} == {"jitter:4,0,0.5", "jitter:4,1,0.5"}


def test_pilot_can_be_a_held_factor():
    campaign_spec = study("latency", "--values", "0,1", "--episodes", TWO, "--hold", "pilot=vision")
    assert [entry.name for entry in campaign_spec.plan.entries] == ["latency-0-f1", "latency-1-f1"]
    assert all(e.flight.pilot == "vision" and e.flight.simulated.rendered for e in campaign_spec.plan.entries)


def dronecats(*words, cwd, program=("-m", "dronecats.cli.main")):
    command = [sys.executable, *program, *words]
    path = os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        command,
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )


# `dronecats`; it never begins its third flight, so it has not ended when the test kills it
STAYS = """
import sys, time
from dronecats.bench.engine import LocalEngine
from dronecats.cli.main import main
begin, begun = LocalEngine.begin, []

def begin_two(engine, sortie):
    begun.append(sortie)
    while len(begun) > 2:
        time.sleep(1.0)
    begin(engine, sortie)

LocalEngine.begin = begin_two
sys.exit(main(sys.argv[1:]))
"""


def finished(process):
    """Return (status, standard output, standard error) of a command after its end."""
    out, errors = process.communicate(timeout=900)
    return process.returncode, out, errors


def logs_of(episode):
    return {name: (episode / name).read_bytes() for name in LOGS}


SMALL = ["study", "latency", "--values", "0,2", "--episodes", TWO, "--pilot", "oracle", "--seconds", "10", "--full"]


@pytest.mark.slow
def test_a_study_flies_into_its_folder_and_each_flight_can_be_repeated_alone(tmp_path, monkeypatch, capsys):
    words = [*SMALL, "--limit", "1", "--out", "s"]
    status, output, errors = finished(dronecats(*words, "--jobs", "1", "--json", cwd=tmp_path))
    assert status == 0, errors
    out = tmp_path / "s"
    value = json_object(out / "study.json")
    assert value is not None
    validator("study").validate(value)
    runs = {"oracle-latency-0-f1", "oracle-latency-2-f1"}
    assert {run.name for run in folder.read(out).runs} == {run.folder.name for run in recorded_runs([out])} == runs
    result = json.loads(output.splitlines()[-1])
    assert (result["study"], result["episodes"], result["done"], set(result["again"])) == ("latency", 2, 2, runs)
    command = shlex.split(result["again"]["oracle-latency-2-f1"])
    assert command[0] == "dronecats"
    status, _, errors = finished(dronecats(*command[1:], cwd=tmp_path))
    assert status == 0, errors
    (first,) = (path for path in (tmp_path / "again" / "oracle-latency-2-f1").iterdir() if path.is_dir())
    assert logs_of(first) == logs_of(out / "oracle-latency-2-f1" / first.name)
    assert logs_of(first) != logs_of(out / "oracle-latency-0-f1" / first.name)
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0  # all flights are complete; none is flown
    output, errors = capsys.readouterr()
    assert "2/2" in errors
    assert f"  {shlex.join(command)}" in output.splitlines()
    assert result["report"] == "dronecats study report s"
    assert main([*words, "--values", "0,1"]) == 2
    errors = capsys.readouterr().err
    assert re.search("factors, latency 0, 2 .*latency 0, 1 .*--out", errors)
    assert errors.count("\n") == 1


@pytest.mark.parametrize(("words", "exact"), [((), True), (("--speed", "20"), False)])
def test_same_bytes_are_promised_only_for_flights_that_repeat_exactly(tmp_path, monkeypatch, capsys, words, exact):
    monkeypatch.setattr(campaign, "fly", lambda *arguments, **options: SimpleNamespace(scores=()))
    monkeypatch.setattr(campaign, "print_result", lambda *arguments, **options: None)
    monkeypatch.setattr(campaign, "status", lambda *arguments: 0)
    out = ("--out", str(tmp_path / "s"))
    assert main(["study", "latency", "--values", "1,2", "--episodes", TWO, "--pilot", "oracle", *words, *out]) == 0
    printed = capsys.readouterr().out
    assert "repeat one flight of each run" in printed
    assert ("same bytes" in printed) == exact


def test_a_flight_repeats_exactly_in_lockstep_without_a_model():
    lockstep = FlightSpec(pilot="oracle", simulated=Simulated(speed=None))
    assert lockstep.repeats_exactly
    model = ModelSpec(provider="local", name="m")
    changes: tuple[dict[str, Any], ...] = (
        {"simulated": Simulated()}, {"pilot": None, "model": model}, {"command": "hierarchical", "commander": model},
        {"latency": LatencyPolicy.parse("measured+fixed:1")},
        {"simulated": Simulated(speed=None, autopilot="px4", px4="px4 -d")},
    )  # fmt: skip
    for change in changes:
        assert not replace(lockstep, **change).repeats_exactly, change


def test_the_open_file_limit_is_raised_to_one_lock_per_run():
    before, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (campaign.SPARE_FILES, hard))
        campaign.allow_locks(3)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (campaign.SPARE_FILES + 3, hard)
        campaign.allow_locks(1)
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (campaign.SPARE_FILES + 3, hard)
        if hard != resource.RLIM_INFINITY:
            with pytest.raises(UsageError, match=f"{hard:,} .*{hard:,}"):
                campaign.allow_locks(hard)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (before, hard))


@pytest.mark.slow
def test_a_killed_and_resumed_study_has_the_same_bytes(tmp_path):
    status, _, errors = finished(dronecats(*SMALL, "--jobs", "1", "--out", "whole", cwd=tmp_path))
    assert status == 0, errors
    process = dronecats(*SMALL, "--jobs", "1", "--out", "torn", cwd=tmp_path, program=("-c", STAYS))
    out = tmp_path / "torn"
    while not list(out.glob("*/*/verdict.json")):
        assert process.poll() is None, finished(process)
        time.sleep(0.05)
    children = psutil.Process(process.pid).children(recursive=True)
    os.kill(process.pid, signal.SIGKILL)
    finished(process)
    _, alive = psutil.wait_procs(children, timeout=20)
    assert not alive
    before = {str(path.relative_to(out)): path.read_bytes() for path in out.glob("*/*/verdict.json")}
    assert 0 < len(before) <= 2
    status, _, errors = finished(dronecats(*SMALL, "--jobs", "1", "--out", "torn", cwd=tmp_path))
    assert status == 0, errors
    for episode in (tmp_path / "whole").glob("*/*/"):
        if (episode / "verdict.json").exists():
            assert logs_of(episode) == logs_of(out / episode.relative_to(tmp_path / "whole"))
    assert (out / "study.json").read_bytes() == (tmp_path / "whole" / "study.json").read_bytes()
    assert all((out / name).read_bytes() == data for name, data in before.items())


@pytest.mark.slow("starts a Ray cluster")
@pytest.mark.xdist_group("ray")  # two clusters at once are too much for two cores
def test_a_study_on_a_cluster_has_the_same_bytes(tmp_path):
    for out, more in (("here", []), ("there", ["--engine", "ray"])):
        status, _, errors = finished(dronecats(*SMALL, "--jobs", "2", "--out", out, *more, cwd=tmp_path))
        assert status == 0, errors
    episodes = [path.parent.relative_to(tmp_path / "here") for path in (tmp_path / "here").glob("*/*/verdict.json")]
    assert len(episodes) == 4
    for episode in episodes:
        assert logs_of(tmp_path / "here" / episode) == logs_of(tmp_path / "there" / episode)
    assert (tmp_path / "here" / "study.json").read_bytes() == (tmp_path / "there" / "study.json").read_bytes()


def test_repeated_factors_and_factors_without_their_base_factor_are_rejected(tmp_path):
    for text, parts in (
        ("[factors]\nlatency = [0, 1]\n[held]\nlink_loss = 0.1\n'link-loss' = 0.2\n", r"\[held\] .*link_loss .*twice"),
        ("[factors]\nlink_loss = [0.1]\n'link-loss' = [0.2]\n", r"\[factors\] .*link_loss .*twice"),
        ("[factors]\nwind_towards = [0, 90]\n", "wind_towards .*0.* wind"),
    ):
        (tmp_path / "s.toml").write_text(f'pilot = ["noisy"]\ncells = ["tracking"]\n{text}')
        with pytest.raises(UsageError, match=parts):
            study("run", str(tmp_path / "s.toml"))
