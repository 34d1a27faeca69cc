"""The options for disturbances, on every command that flies."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from dronecats.cli import bench_spec
from dronecats.cli.fly_spec import replay_line, spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec.disturbances import DECLARED, UNDISTURBED, Disturbances, FlightConditions, FrameFaults
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from dronecats.flight.spec.spec_file import as_json, from_json
from foundation.errors import UsageError
from tests.flight.spec.test_recording import EASY, FLOWN, folder

WORDS = ["--frame-delay", "0.5", "--frame-drop", "0.1", "--frame-stale", "0.2", "--frame-rate", "4"]
FRAME = FrameFaults(delay_s=0.5, dropped=0.1, stale=0.2, rate_hz=4.0)


def test_fly_options_bench_options_and_spec_files_give_the_same_disturbances(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spec = spec_of(parse(["fly", "--sitl", "--pilot", "oracle", *WORDS]))
    assert spec.disturbances == Disturbances(frame=FRAME)
    Path("my.toml").write_text(
        'suite = "quick"\npilot = "oracle"\nframe_delay = 0.5\nframe_drop = 0.1\nframe-stale = 0.2\nframe_rate = 4\n'
    )
    for words in (["my.toml"], ["--suite", "quick", "--pilot", "oracle", *WORDS]):
        args = bench_spec.with_file(parse(["bench", *words]))
        (entry,) = bench_spec.runs(args, bench_spec.suite(args), Path("out"))
        assert entry.flight.disturbances == spec.disturbances
        assert json.dumps(as_json(entry.flight)["disturbances"]) == json.dumps(as_json(spec)["disturbances"])
    assert spec_of(parse(["fly", "--sitl"])).disturbances == UNDISTURBED
    assert from_json(json.loads(json.dumps(as_json(spec))), "here") == spec


def test_light_and_season_options_are_parsed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text(
        'suite = "quick"\npilot = "oracle"\nsun = "270,15"\nsky = "overcast"\nseason = "autumn"\n'
    )
    args = bench_spec.with_file(parse(["bench", "my.toml"]))
    (entry,) = bench_spec.runs(args, bench_spec.suite(args), Path("out"))
    words = ["--sun", "270,15", "--sky", "overcast", "--season", "autumn"]
    spec = spec_of(parse(["fly", "--sitl", *words]))
    expected = FlightConditions(sun_azimuth_deg=270.0, sun_elevation_deg=15.0, sky="overcast", season="autumn")
    assert entry.flight.disturbances.conditions == spec.disturbances.conditions == expected
    plain = spec_of(parse(["fly", "--sitl", "--sky", "clear", "--season", "summer"]))
    assert plain == spec_of(parse(["fly", "--sitl"]))


def test_every_option_has_a_help_text_and_is_on_the_docs_page():
    page = (Path(__file__).parents[2] / "docs" / "disturbances.md").read_text(encoding="utf-8")
    for option in (field.option for _, _, field in DECLARED if field.option):
        assert option.help
        assert f"--{option.name.replace('_', '-')}" in page


def test_invalid_values_are_rejected_in_one_sentence(capsys):
    for words, parts in (
        (["--sitl", "--frame-drop", "1"], "frame_drop .*0 .*0.95, .*1"),
        (["--sitl", "--frame-delay", "-1"], "delay .*0 .*60 s"),
        (["--sitl", "--frame-rate", "0.1", "--frame-delay", "9"], "delay .*period .*15 s"),
        (["--sitl", "--sun", "40,2"], "sun_elevation .*3 .*90 °, .*2"),
        (["--sitl", "--sun", "40"], "--sun .*AZ,EL"),
        (["--sitl", "--sun", "40,30", "--sky", "dusk"], "dusk .*--sun"),
        (["--connect", "udpin://0.0.0.0:14540", "--frame-delay", "1"], "--frame-delay .*--sitl"),
    ):
        assert main(["fly", *words]) == 2, words
        error = capsys.readouterr().err.strip()
        assert re.search(parts, error), error
        assert len(error.splitlines()) == 1, words


def test_invalid_values_in_a_spec_file_are_rejected(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("my.toml").write_text('suite = "quick"\npilot = "oracle"\nframe_delay = "late"\n')
    assert main(["bench", "my.toml"]) == 2
    assert "frame_delay" in capsys.readouterr().err


def test_a_replay_uses_the_disturbances_of_its_run_unless_options_override_them(tmp_path, capsys):
    spec = replace(FLOWN, disturbances=Disturbances(frame=FRAME))
    kept = folder(tmp_path / "run", spec)
    words = ["--sitl", "--model", f"replay:{kept}"]
    assert spec_of(parse(["fly", *words])).disturbances == spec.disturbances
    other = parse(["fly", *words, "--frame-delay", "0"])
    assert spec_of(other).disturbances == Disturbances(frame=replace(FRAME, delay_s=0.0))
    assert replay_line(other, EASY).endswith("--frame-delay")
    assert main(["fly", "--spec", str(kept / "run.json"), "--frame-delay", "1"]) == 2
    assert "--frame-delay" in capsys.readouterr().err


def test_disturbances_are_rejected_with_a_connected_vehicle():
    from dronecats.flight.spec.flight_spec import Connected

    with pytest.raises(UsageError, match=r"disturbances .*--sitl"):
        FlightSpec(
            pilot="vision", instruction="go", connected=Connected(url="x"), disturbances=Disturbances(frame=FRAME)
        )


def test_the_description_contains_every_value():
    assert UNDISTURBED.words is None
    for disturbances, values in (
        (Disturbances(frame=FRAME), ["4", "0.5", "10", "20"]),
        (Disturbances(vehicle=replace(UNDISTURBED.vehicle, wind_ned=(3.0, -4.0, 0.0), payload_kg=0.2)),
         ["3", "-4", "0.2"]),
    ):  # fmt: skip
        assert re.findall(r"-?\d[\d.]*", disturbances.words or "") == values


def test_bench_names_a_latency_trace_after_its_values(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("x.csv").write_text("0.5\n1.5\n")
    args = bench_spec.with_file(
        parse(["bench", "--suite", "quick", "--pilot", "oracle", "--latency", "trace:x.csv", "cap:0.5"])
    )
    entries = bench_spec.runs(args, bench_spec.suite(args), Path("out"))
    assert [entry.flight.latency.trace for entry in entries] == [(0.5, 1.5), None]
    assert [entry.name for entry in entries] == [f"oracle-flat-{str(entries[0].flight.latency).replace(':', '-')}-f1",
                                                 "oracle-flat-cap-0.5-f1"]  # fmt: skip
    assert entries[0].flight.simulated == Simulated(speed=None, rendered=False)
    args.latency = ["trace:none.csv"]
    with pytest.raises(UsageError, match=r"none\.csv"):
        bench_spec.runs(args, bench_spec.suite(args), Path("out"))
