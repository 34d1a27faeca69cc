"""The rest of the program can read the files of a measured chain: trace, study and commands."""

import csv
import random
import shlex
import tomllib
from pathlib import Path

import pytest

from dronecats.cli import bench_spec, study_spec
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import parse
from dronecats.cli.next_commands import next_commands
from dronecats.cli.study_rate import next_command_values
from dronecats.flight.spec.flight_spec import read_trace
from dronecats.report.writers import as_terminal
from dronecats.study.rate.chain import COLUMNS, TRACE, ChainLog, QuestionTimes, summarize, summary_table, write_replay
from foundation.errors import InfrastructureError
from tests.docs.pages import ROOT


def measured(count: int, wait_s: float = 0.01) -> list[QuestionTimes]:
    draw = random.Random(5)
    return [
        QuestionTimes(
            step=step, frame_id=step, age_s=0.2 + step * 1e-3, wait_s=wait_s, encode_s=0.005, failed_s=0.0,
            model_s=round(draw.lognormvariate(-1, 0.5), 6), parse_s=0.001, tick_s=0.05,
            step_s=round(0.5 + draw.random(), 6), latency_s=round(draw.lognormvariate(-1, 0.5), 6),
            rate_hz=0.3 if step else None,
        )
        for step in range(count)
    ]  # fmt: skip


@pytest.fixture
def rig(tmp_path):
    folder = tmp_path / "my rig's"  # needs quotes in a shell
    folder.mkdir()
    return folder


def test_the_written_trace_contains_the_measured_latencies(rig):
    times = measured(30)
    write_replay(rig, times, 0.21)
    assert read_trace(rig / TRACE) == tuple(question.latency_s for question in times)


def test_a_latency_above_the_maximum_is_written_as_the_maximum(rig):
    (times,) = measured(1)
    slow = QuestionTimes(**{**{name: getattr(times, name) for name in COLUMNS}, "latency_s": 400.0})
    write_replay(rig, [slow], 0.0)
    assert read_trace(rig / TRACE) == (300.0,)


@pytest.mark.parametrize("delay_s", [0.21, 0.0])
def test_every_suggested_command_uses_the_trace_and_the_delay(rig, delay_s):
    times = measured(12)
    charged = tuple(question.latency_s for question in times)
    write_replay(rig, times, delay_s)
    commands = next_commands("study rate", **next_command_values(rig, delay_s))
    fly, bench, study = (parse(shlex.split(line)[1:]) for line in commands)
    flight = spec_of(fly)
    assert (flight.latency.trace, flight.disturbances.frame.delay_s) == (charged, delay_s)
    bench = bench_spec.with_file(bench)
    (entry,) = bench_spec.runs(bench, bench_spec.suite(bench), rig)
    assert (entry.flight.latency.trace, entry.flight.disturbances.frame.delay_s) == (charged, delay_s)
    entries = study_spec.of_file(study).plan.entries
    points = {(planned.flight.latency.trace, planned.flight.disturbances.frame.delay_s) for planned in entries}
    assert points == {(trace, delay) for trace in (None, charged) for delay in {0.0, delay_s}}
    assert {str(planned.flight.latency) for planned in entries if planned.flight.latency.trace is None} == {"fixed:0"}


def test_the_study_finds_its_trace_from_any_folder(rig, tmp_path, monkeypatch):
    times = measured(12)
    monkeypatch.chdir(rig.parent)
    write_replay(Path(rig.name), times, 0.21)
    moved = rig.rename(tmp_path / "moved")
    monkeypatch.chdir("/")
    entries = study_spec.of_file(parse(["study", "run", str(moved / "study.toml")])).plan.entries
    charged = tuple(question.latency_s for question in times)
    assert {planned.flight.latency.trace for planned in entries} == {None, charged}
    (moved / "bench.toml").write_text('suite = "quick"\npilot = "vision"\nlatency = "trace:trace.csv"\n')
    bench = bench_spec.with_file(parse(["bench", str(moved / "bench.toml")]))
    (entry,) = bench_spec.runs(bench, bench_spec.suite(bench), tmp_path)
    assert entry.flight.latency.trace == charged


def test_questions_are_written_line_by_line_and_each_column_is_documented(rig):
    log, times = ChainLog(rig), measured(3)
    for question in times:
        log.write(question)
    with (rig / "chain.csv").open(newline="") as file:  # before the log is closed, as after a kill
        rows = list(csv.DictReader(file))
    log.close()
    assert [float(row["model_s"]) for row in rows] == [question.model_s for question in times]
    assert [row["rate_hz"] for row in rows] == ["", "0.3", "0.3"]
    page = (ROOT / "docs" / "rate.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in page for name in COLUMNS)


def test_a_missing_folder_is_reported(tmp_path):
    with pytest.raises(InfrastructureError, match=r"chain\.csv"):
        ChainLog(tmp_path / "nowhere")


def test_the_summary_has_counts_and_quantiles():
    times = measured(20)
    summary = summarize(times, "local/m", camera_stamps=False)
    ordered = sorted(question.model_s for question in times)
    model = summary.links["model_s"]
    assert (model["min"], model["max"]) == (ordered[0], ordered[-1])
    assert model["median"] == pytest.approx((ordered[9] + ordered[10]) / 2, abs=1e-6)
    assert model["p90"] == pytest.approx(ordered[17] + 0.1 * (ordered[18] - ordered[17]), abs=1e-6)
    assert summary.chain_hz["max"] == pytest.approx(1 / min(question.step_s for question in times), abs=1e-6)
    assert summary.served_hz
    assert summary.served_hz["median"] == 0.3
    assert summarize(measured(21), "m", camera_stamps=True).frame_delay_s == 0.21
    assert summarize(measured(20, wait_s=0.7), "m", camera_stamps=True).frame_delay_s == 0.7
    text = as_terminal(summary_table(summary, 30))
    assert "20 of 30" in text
    assert "local/m" in text
    assert text != as_terminal(summary_table(summarize(times, "local/m", camera_stamps=True), 30))
    assert summarize(times[:1], "m", camera_stamps=True).served_hz is None


def test_a_study_without_frame_delay_has_no_frame_delay_factor(rig):
    write_replay(rig, measured(2), 0.0)
    assert "frame_delay" not in tomllib.loads((rig / "study.toml").read_text(encoding="utf-8"))["factors"]
