"""The effect of a busy host on flights and the precision of the stall mark, compared with counts by hand."""

import dataclasses
import json
import os
import re
import subprocess
import sys
import textwrap

import psutil
import pytest

from dronecats.cli.main import main
from dronecats.report.writers import as_markdown
from dronecats.study.host_load import LoadedFlight, busy, compare, tables
from tests.support.command_line import DRONECATS

ONE = LoadedFlight(
    episode="a", clock="lockstep", busy=0, flight=1, success=True, ne_m=1.0, steps=10, stalled_steps=0, digest="same"
)


def flight(**other):
    return dataclasses.replace(ONE, **other)


def real(**other):
    return flight(clock="real time", digest="other", **other)


FLIGHTS = [
    flight(),
    flight(episode="b", success=False, ne_m=9.0),
    real(ne_m=1.2),
    real(episode="b", success=False, ne_m=8.9, stalled_steps=1),
    flight(busy=4),
    flight(episode="b", busy=4, success=False, ne_m=9.0, digest="changed"),
    real(busy=4, success=False, ne_m=7.0, stalled_steps=3),
    real(episode="b", busy=4, success=True, ne_m=9.1),
]


def test_each_flight_is_compared_with_its_lockstep_flight_on_the_idle_host():
    comparison = compare(FLIGHTS)
    rows = {(row.clock, row.busy): row for row in comparison.rows}
    assert [(row.flights, row.solved, row.moved, row.other_bytes) for row in rows.values()] == [
        (2, 1, 0, 0), (2, 1, 0, 2), (2, 1, 0, 1), (2, 1, 2, 2),
    ]  # fmt: skip
    assert rows["real time", 4].ne_moved_m == pytest.approx(3.05)  # mean of 6 m and 0.1 m
    assert rows["real time", 4].marked == 1
    assert (rows["real time", 4].stalled_steps, rows["real time", 4].steps) == (3, 20)


def test_precision_and_recall_of_the_stall_mark_equal_counts_by_hand():
    comparison = compare(FLIGHTS)
    verdicts = comparison.marking_of_verdicts
    assert (verdicts.moved, verdicts.marked, verdicts.both) == (2, 2, 1)
    assert verdicts.precision is not None
    assert verdicts.recall is not None
    assert verdicts.precision[0] == verdicts.recall[0] == 0.5
    assert comparison.idle_error_m == pytest.approx(0.2)  # of 0.2 and 0.1 m
    errors = (
        comparison.marking_of_errors
    )  # busy host only: one flight is 6 m off and marked, one is 0.1 m off and unmarked
    assert (errors.moved, errors.marked, errors.both) == (1, 1, 1)


def test_precision_and_recall_are_undefined_without_moved_or_marked_flights():
    comparison = compare([flight(), real(ne_m=None)])
    assert comparison.marking_of_verdicts.precision is None
    assert comparison.marking_of_verdicts.recall is None
    assert comparison.idle_error_m is None
    assert "| – | – |" in as_markdown(tables(comparison)[1])
    json.dumps(dataclasses.asdict(comparison), allow_nan=False)


def test_busy_processes_use_the_cpu_and_end_with_the_block():
    with busy(2) as started:
        assert len({os.getsid(0), *(os.getsid(process.pid) for process in started)}) == 3  # each has its own session
        watched = [psutil.Process(process.pid) for process in started]
        while any(sum(process.cpu_times()[:2]) == 0.0 for process in watched):
            assert all(process.is_running() for process in watched)
    assert not any(process.is_running() for process in watched)


def test_busy_processes_end_if_their_parent_is_killed():
    script = textwrap.dedent("""
        import os, time
        from dronecats.study.host_load import busy
        with busy(1) as started:
            print(started[0].pid, flush=True)
            time.sleep(600)
    """)
    starter = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert starter.stdout is not None
    computing = psutil.Process(int(starter.stdout.readline()))
    starter.kill()
    starter.wait()
    starter.stdout.close()
    _, alive = psutil.wait_procs([computing], timeout=60)
    assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]


def test_invalid_levels_are_rejected(tmp_path, capsys):
    for levels in ("", "some", "0,0", "-1", "1000"):
        assert main(["study", "load", f"--busy={levels}", "--out", str(tmp_path / "run")]) == 2, levels
        assert "--busy" in capsys.readouterr().err
        assert not (tmp_path / "run").exists()


def test_options_invalid_for_one_clock_are_rejected_before_any_flight(tmp_path, capsys):
    for words, parts in (
        (["--speed", "0"], "--speed .*0.01 .*100.* 0"),  # invalid in real time
        (["--latency", "real"], "--latency real .*--speed max"),  # invalid in lockstep
        (["--pilot", "nobody"], "'nobody'"),
        (["--seconds", "nan"], "--seconds .*0"),
        (["--out", __file__], __file__),
    ):
        out = tmp_path / "run"
        assert main(["study", "load", "--out", str(out), "--busy", "0", "--seconds", "4", *words]) == 2, words
        (complaint,) = capsys.readouterr().err.strip().splitlines()
        assert re.search(parts, complaint), complaint
        assert not out.exists(), words


@pytest.mark.slow("flies a study in real time beside busy processes")
def test_a_study_is_flown_resumed_and_reported(tmp_path):
    command = [
        *DRONECATS, "study", "load", "--busy", "0,2", "--episodes", "residential-approaching-01", "--seconds", "4",
        "--out", str(tmp_path / "run"), "--json",
    ]  # fmt: skip
    first = subprocess.run(command, capture_output=True, text=True)
    assert first.returncode == 0, first.stderr
    output = json.loads(first.stdout)
    assert [(row["clock"], row["busy"], row["flights"]) for row in output["rows"]] == [
        ("lockstep", 0, 1), ("real time", 0, 1), ("lockstep", 2, 1), ("real time", 2, 1),
    ]  # fmt: skip
    assert output["rows"][2]["other_bytes"] == 0  # lockstep does not depend on the host
    log = tmp_path / "run" / "real-time-busy-2-f1" / "residential-approaching-01" / "decisions.jsonl"
    modified_ns = log.stat().st_mtime_ns
    again = subprocess.run(command, capture_output=True, text=True)
    assert json.loads(again.stdout) == output
    assert log.stat().st_mtime_ns == modified_ns
