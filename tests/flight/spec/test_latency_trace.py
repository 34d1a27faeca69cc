"""Latencies from a run or a CSV become part of the flight spec, which then does not refer to the file."""

import json
from pathlib import Path

import pytest

from dronecats.agent.latency import trace_name
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import parse
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import latency_policy, read_trace
from dronecats.flight.spec.spec_file import as_json, from_json
from foundation.errors import UsageError
from tests.support.refusal import refusal
from tests.support.run_folders import run_folder

ROW = {"drone": 0, "frame_id": 1, "t_frame": 0.0, "t_decided": 1.0, "action": None, "error": "none", "reply": "x"}


def log(folder: Path, latencies, drones=1):
    folder.mkdir(parents=True)
    decisions = [{**ROW, "step": step, "drone": drone, "latency_s": seconds}
            for step, seconds in enumerate(latencies) for drone in range(drones)]  # fmt: skip
    (folder / "decisions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in decisions))
    return folder


def test_a_run_gives_one_latency_per_question_in_the_order_of_its_episodes(tmp_path):
    log(tmp_path / "run" / "b", [0.5, None, 0.7])
    log(tmp_path / "run" / "a", [1.25, 2.0], drones=4)
    assert read_trace(tmp_path / "run") == (1.25, 2.0, 0.5, 0.7)
    assert read_trace(tmp_path / "run" / "b") == (0.5, 0.7)
    assert len(read_trace(run_folder(tmp_path / "whole", {"campus-tracking-01": "go"}, steps=7))) == 7


def test_unfinished_and_retried_flights_of_a_run_are_left_out(tmp_path):
    log(tmp_path / "a", [1.25])
    log(tmp_path / "unfinished" / "a-1", [9.0])
    log(tmp_path / "retried" / "a", [8.0])
    assert read_trace(tmp_path) == (1.25,)
    assert read_trace(tmp_path / "unfinished" / "a-1") == (9.0,)


@pytest.mark.parametrize(
    "text",
    ["0.5\n1\n0.25\n", "latency_s\n0.5\n1\n0.25\n", "t, latency_s ,x\n9,0.5,a\n\n9,1,b\n9,0.25,c\n",
     "\ufefflatency_s,b\n0.5,1\n1,2\n0.25,3\n"],
)  # fmt: skip
def test_a_csv_is_read_from_its_latency_column_or_its_only_column(tmp_path, text):
    (tmp_path / "x.csv").write_text(text)
    assert read_trace(tmp_path / "x.csv") == (0.5, 1.0, 0.25)


def test_traces_without_latencies_are_rejected(tmp_path):
    for text, word in [
        ("", "x.csv"),
        ("latency_s\n", "x.csv"),
        ("a,b\n1,2\n", "latency_s"),
        ("0.5\nfast\n", "latency 2"),
        ("latency_s,b\n0.5,1\n,3\n", "latency 2"),
        ("1\n" * 10_001, "10,000"),
        ("-1\n", "300"),
        ("nan\n", "300"),
    ]:
        (tmp_path / "x.csv").write_text(text)
        assert word in refusal(latency_policy, f"trace:{tmp_path / 'x.csv'}"), text[:20]


def test_missing_and_binary_files_are_rejected(tmp_path):
    with pytest.raises(UsageError, match=r"none\.csv"):
        latency_policy(f"trace:{tmp_path / 'none.csv'}")
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="CSV"):
        latency_policy(f"trace:{tmp_path / 'x.csv'}")


@pytest.mark.parametrize("text", ["trace:", "trace:+cap:1"])
def test_a_trace_without_a_file_does_not_read_the_current_folder(text, tmp_path, monkeypatch):
    (tmp_path / "x.csv").write_text("0.5\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="names no file"):
        latency_policy(text)


def test_paths_that_are_not_regular_files_are_rejected():
    with pytest.raises(UsageError, match="/dev/zero"):
        latency_policy("trace:/dev/zero")


def test_the_flight_spec_holds_the_latencies_and_not_the_file_and_is_json(tmp_path):
    (tmp_path / "a+b.csv").write_text("0.5\n1.5\n")
    words = ["--sitl", "--speed", "max", "--pilot", "oracle"]
    spec = spec_of(parse(["fly", *words, "--latency", f"stall:0.1,2+trace:{tmp_path / 'a+b.csv'}"]))
    name = trace_name((0.5, 1.5))
    assert (str(spec.latency), spec.latency.trace) == (f"stall:0.1,2+trace:{name}", (0.5, 1.5))
    assert str(tmp_path) not in json.dumps(as_json(spec))
    again = from_json(json.loads(json.dumps(as_json(spec))), "here")
    assert again == spec
    assert as_json(again)["latency_trace"] == (0.5, 1.5)
    look_up(again)
    assert spec_of(parse(["fly", *words, "--latency", "fixed:1"])).latency.trace is None
