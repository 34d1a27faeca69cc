"""The command `dronecats bench`: rejected arguments, spec files, and the results after processes are killed."""

import json
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from dronecats.cli import bench_spec
from dronecats.cli.main import main, parse
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.pilots.server import PilotServer
from foundation.run_folder.reading import json_object
from tests.support.children import children

EASY = "residential-approaching-01"
THREE = (EASY, "residential-searching-01", "campus-tracking-01")
KEY = "sk-SECRET-1234567890"


def runs(*words):
    args = bench_spec.with_file(parse(["bench", *words]))
    chosen = bench_spec.suite(args)
    return args, bench_spec.runs(args, chosen, Path("out"))


def test_invalid_arguments_are_rejected_in_one_sentence(capsys, tmp_path, monkeypatch):
    for words, parts in (
        (["--suite", "quick"], "--model .*--pilot"),
        (["--pilot", "oracle"], "--suite"),
        (["--suite", "quik", "--pilot", "oracle"], "quick"),
        ([EASY, "--suite", "quick", "--pilot", "oracle"], "--suite"),
        ([EASY, "--pilot", "orakel"], "oracle"),
        ([EASY, "--pilot", "oracle", "--rate", "2", "--latency", "fixed:1"], "--rate .*--latency"),
        ([EASY, "--pilot", "oracle", "--rate", "0"], "--latency rate:HZ"),
        ([EASY, "--pilot", "oracle", "--latency", "real"], "--latency real .*--speed max"),
        ([EASY, "--pilot", "oracle", "--shard", "0/2"], "--shard .*0/2"),
        ([EASY, "--pilot", "oracle", "--shard", "3/2"], "--shard .*3/2"),
        ([EASY, "--pilot", "oracle", "--shard", "1"], "--shard .*1"),
        ([EASY, "--pilot", "oracle", "--jobs", "0"], "--jobs .*1 .*0"),
        ([EASY, "--pilot", "oracle", "--flights", "0"], "--flights .*1 .*0"),
        ([EASY, "--pilot", "oracle", "--limit", "0"], "--limit .*1 .*0"),
        ([EASY, "--pilot", "oracle", "--axis", "yx"], "--axis .*--model"),
        ([EASY, "--pilot", "oracle", "--cost-limit", "3"], "--cost-limit .*--model"),
        ([EASY, "--pilot", "oracle", "--commander", "scripted:divide"], "--commander .*--command hierarchical"),
        ([EASY, "--pilot", "oracle", "--command", "loud"], "--command .*flat, hierarchical, solo"),
        ([EASY, "--pilot", "oracle", "--agent", "nobody"], "nobody.*paper, steady.*MODULE:NAME"),
        ([EASY, "--pilot", "oracle", "--agent", "json:nothing"], "--agent json:nothing "),
        (
            [EASY, "--pilot", "oracle", "--agent", "steady", "--command", "hierarchical"],
            "--agent steady .*--command flat .*solo",
        ),
        ([EASY, "--pilot", "oracle", "oracle"], "oracle-flat-fixed-0.5-f1"),
        ([EASY, "--model", "local/x"], "--base-url"),
        (["no-such.toml"], "no-such.toml"),
    ):
        monkeypatch.chdir(tmp_path)
        assert main(["bench", *words, "--out", "out"]) == 2, words
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert len(error.strip().splitlines()) == 1, words
        assert not (tmp_path / "out").exists(), words


FILE = """
suite = ["quick"]
pilot = ["oracle"]
model = ["local/a", { name = "local/b", base_url = "http://h:1/v1", axis = "yx", called = "bee" }]
command = ["flat", "solo"]
rate = [2, 0.5]
flights = 2
seed = 5
jobs = 16
limit = 3
cost_limit = 20
token_limit = 1000
parser = "lenient"
full = true
no_retry = true
"""


def test_a_file_is_equivalent_to_options(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    words = ["--suite", "quick", "--pilot", "oracle", "--model", "local/a", "--command", "flat", "solo"]
    words += ["--rate", "2", "0.5", "--flights", "2", "--seed", "5", "--parser", "lenient", "--full"]
    words += ["--cost-limit", "20", "--token-limit", "1000"]
    args, file_runs = runs("my.toml")
    assert (args.jobs, args.limit, args.no_retry, args.out) == (16, 3, True, Path("runs/my"))
    _, option_runs = runs(*words)
    by_name = {run.name: run for run in file_runs}
    for run in option_runs:
        assert by_name[run.name] == run
    others = set(by_name) - {run.name for run in option_runs}
    assert others == {f"bee-{c}-rate-{r}-f{k}" for c in ("flat", "solo") for r in ("2", "0.5") for k in (1, 2)}
    kept = as_redacted_json(by_name["bee-flat-rate-2-f1"].flight)["model"]
    assert (kept["name"], kept["base_url"], kept["axis_order"]) == ("b", "http://h:1/v1", "yx")


def test_rows_of_one_model_may_have_different_request_settings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    row = '{{ name = "openrouter/maker/m", base_url = "http://h:1/v1", {}, called = "{}" }}'
    settings = {"low": 'reasoning = "low", max_tokens = 512', "high": 'reasoning = "high", top_p = 0.5'}
    rows = [row.format(words, name) for name, words in settings.items()]
    Path("my.toml").write_text(f'suite = ["quick"]\nmodel = [{", ".join(rows)}]\n')
    low, high = (run.flight.model for run in runs("my.toml")[1])
    assert low is not None
    assert high is not None
    assert (low.quick, low.max_tokens, low.top_p) == ({"reasoning": {"effort": "low"}}, 512, None)
    assert (high.quick, high.max_tokens, high.top_p) == ({"reasoning": {"effort": "high"}}, 8192, 0.5)


def test_each_agent_gets_its_own_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    both = ["--suite", "quick", "--pilot", "oracle", "--agent", "paper", "steady", "mine.own:agent", "paper"]
    _, all_runs = runs(*both)
    assert {run.name: run.flight.agent for run in all_runs} == {
        "oracle-flat-fixed-0.5-f1": "paper",
        "oracle-steady-flat-fixed-0.5-f1": "steady",
        "oracle-mine.own-agent-flat-fixed-0.5-f1": "mine.own:agent",
    }
    _, alone = runs("--suite", "quick", "--pilot", "oracle")
    assert alone == all_runs[:1]
    Path("my.toml").write_text('suite = ["quick"]\npilot = "oracle"\nagent = ["paper", "steady"]\n')
    assert runs("my.toml")[1] == all_runs[:2]


def test_the_command_line_goes_before_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(FILE)
    args, file_runs = runs(
        "my.toml", "--jobs", "2", "--flights", "1", "--rate", "4", "--out", "there", "--parser", "strict"
    )
    assert (args.jobs, args.out) == (2, Path("there"))
    assert {str(run.flight.latency) for run in file_runs} == {"rate:4"}
    assert {run.flight.seed for run in file_runs} == {5}
    assert {run.flight.parser for run in file_runs} == {"strict"}


@pytest.mark.parametrize(
    ("text", "option", "dropped"),
    [
        ('episodes = ["residential-approaching-01"]', ("--suite", "quick"), "episodes"),
        ('suite = ["quick"]\nlatency = "fixed:1"', ("--rate", "4"), "latency"),
        ('suite = ["quick"]\nrate = 4', ("--latency", "fixed:1"), "rate"),
    ],
)
def test_an_option_overrides_its_alternative_in_the_file(tmp_path, monkeypatch, text, option, dropped):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(f'{text}\npilot = "oracle"\n')
    args, file_runs = runs("my.toml", *option)
    assert not getattr(args, dropped)
    assert file_runs == runs(*(("--suite", "quick") if dropped != "episodes" else ()), *option, "--pilot", "oracle",
                             "--out", "runs/my")[1]  # fmt: skip


def test_invalid_spec_files_are_rejected_in_one_sentence(tmp_path, monkeypatch, capsys):
    for text, parts in (
        ("flihgts = 2", "'flihgts' .*flights"),
        ("flights = 2.5", "flights .*2.5"),
        ("flights = true", "flights .*[Tt]rue"),
        ("suite = [1]", "suite "),
        ("suite = []", "suite "),
        ('rate = ["two"]', "rate "),
        ("full = 1", "full "),
        ('cost_limit = "much"', "cost_limit "),
        ("out = []", "out "),
        ("suite = ", "my.toml"),
        ('axis = "zz"', "axis .*xy, yx"),
        ('suite = "quick"\nmodel = [{name = "local/x", tempo = 1}]', "'tempo'"),
        ('suite = "quick"\nmodel = [{axis = "yx"}]', "name"),
        (
            'suite = "quick"\nmodel = [{name = "local/x", base_url="http://h/v1", axis = "zz"}]',
            "axis .*local/x .*xy, yx",
        ),
    ):
        monkeypatch.chdir(tmp_path)
        Path("my.toml").write_text(text)
        assert main(["bench", "my.toml"]) == 2, text
        error = capsys.readouterr().err
        assert re.search(parts, error), error
        assert len(error.strip().splitlines()) == 1, text


# `dronecats bench`; it waits before its second and its third flight, until the test allows it to begin
GATED = """
import sys, time
from pathlib import Path
from dronecats.bench.engine import LocalEngine
from dronecats.cli.main import main
gates, begin, begun = Path(sys.argv[1]), LocalEngine.begin, []

def gated(engine, sortie):
    begun.append(sortie)
    if len(begun) in (2, 3):
        (gates / f"waits-{len(begun)}").touch()
        while not (gates / f"begins-{len(begun)}").exists():
            engine._advance()  # the earlier flights go on
            time.sleep(0.02)
    begin(engine, sortie)

LocalEngine.begin = gated
sys.exit(main(sys.argv[2:]))
"""


def bench(out, *words, program=("-m", "dronecats.cli.main")):
    command = [sys.executable, *program, "bench", "--out", str(out), *words]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "OPENAI_API_KEY": KEY}
    )


def finished(process):
    """Return (status, standard output, standard error) of a command after its end."""
    out, errors = process.communicate(timeout=900)
    return process.returncode, out, errors


@pytest.mark.slow
def test_one_budget_covers_all_flights_and_ends_the_run(tmp_path):
    """Two runs of a model that always rotates. The budget ends in the first steps of the first run."""
    with PilotServer(lambda prompt, pictures: '{"action": "rotate", "angle_deg": 90}', "turns") as server:
        words = [*THREE[:2], "--model", "local/turns", "--base-url", server.base_url, "--flights", "2", "--jobs", "2"]
        status, out, errors = finished(bench(tmp_path / "b", *words, "--token-limit", "3000", "--json"))
        assert status == 3, errors
        result = json.loads(out.splitlines()[-1])
        assert (result["ending"], result["episodes"]) == ("budget", 4)
        assert result["done"] < 4
        assert result["spent"]["tokens"] >= 3000
        assert "3,000 tokens" in errors
        again, out, errors = finished(bench(tmp_path / "b", *words, "--token-limit", "3000", "--json"))
        assert again == 3  # no budget is left, so the command ends without a flight
        assert json.loads(out.splitlines()[-1])["spent"] == result["spent"]
    assert len(list(tmp_path.glob("b/**/ledger.sqlite"))) == 1
    kept = json_object(tmp_path / "b" / "bench.json")
    assert kept is not None
    assert [run["name"] for run in kept["runs"]] == [f"local-turns-flat-fixed-0.5-f{k}" for k in (1, 2)]


def deterministic_logs(out):
    """Return the log files that are deterministic in lockstep, by relative path."""
    names = ("truth.jsonl", "decisions.jsonl", "verdict.json")
    return {str(f.relative_to(out)): f.read_bytes() for name in names for f in sorted(out.glob(f"*/*/{name}"))}


def wait_for(condition, process):
    """Wait until a condition is true while a process runs, and return its value."""
    while not (value := condition()):
        assert process.poll() is None, finished(process)
        time.sleep(0.05)
    return value


@pytest.mark.slow("a run is killed and resumed several times")
def test_a_killed_run_resumes_and_ends_with_the_same_bytes(tmp_path):
    words = [*THREE, "--pilot", "oracle", "--flights", "2", "--jobs", "2"]
    status, _, errors = finished(bench(tmp_path / "whole", *words))
    assert status == 0, errors
    expected, draw = deterministic_logs(tmp_path / "whole"), random.Random(12)
    assert len(expected) == 3 * 6
    out = tmp_path / "torn"
    for number in range(2):
        gates = tmp_path / f"gates-{number}"
        gates.mkdir()
        began_ns = time.time_ns()
        process = bench(out, *words, program=("-c", GATED, str(gates)))

        def workers(process=process):
            return children("dronecats.bench.worker", process.pid)

        def has_flown(began_ns=began_ns):  # a worker that dies before its first flight ends the run
            return any(log.stat().st_mtime_ns > began_ns for log in out.glob("*/*/flight.tlog"))

        wait_for((gates / "waits-2").exists, process)
        wait_for(has_flown, process)
        victim = draw.choice(wait_for(workers, process))
        time.sleep(draw.uniform(0.0, 3.0))  # a random moment of the first flight
        victim.kill()
        (gates / "begins-2").touch()
        wait_for((gates / "waits-3").exists, process)
        flying = wait_for(workers, process)
        time.sleep(draw.uniform(0.0, 3.0))  # a random moment of the second flight
        process.kill()
        finished(process)
        _, alive = psutil.wait_procs(flying, timeout=20)
        assert not alive
        stored = deterministic_logs(out)
        done = [place for place in stored if place.endswith("verdict.json") and b'"error"' not in stored[place][:40]]
        for place in done:  # finished flights keep their bytes
            assert stored[place] == expected[place]
    status, _, errors = finished(bench(out, *words))
    assert status == 0, errors
    assert deterministic_logs(out) == expected
    status, output, errors = finished(bench(out, *words))  # no flight remains
    assert (status, "6/6" in errors) == (0, True)
    assert "6/6" in output
