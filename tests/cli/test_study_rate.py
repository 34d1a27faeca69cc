"""The command `dronecats study rate`: invalid arguments are rejected in one sentence before anything is sent."""

import re

from dronecats.cli import study_rate
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec.flight_spec import Authority

RIG = ["study", "rate", "--connect", "udpin://127.0.0.1:14599", "--camera", "http://127.0.0.1:9/picture.jpg"]
MODEL = ["--model", "local/m", "--base-url", "http://127.0.0.1:9/v1"]


def test_invalid_arguments_are_rejected_in_one_sentence(capsys, tmp_path, monkeypatch):
    for words, parts in (
        (MODEL, "--dry-run"),
        ([*MODEL, "--dry-run", "--questions", "4"], "--questions .*5 .*10,000, .*4"),
        ([*MODEL, "--dry-run", "--seconds", "-1"], "--seconds .*0, .*300 .*-1"),
        ([*MODEL, "--dry-run", "--cache", "kept"], "--cache"),
        ([*MODEL, "--dry-run", "--pilot", "vision"], "--pilot .*--model"),
        (["--dry-run", "--model", "replay:runs/x"], "--model replay:RUN .*--sitl"),
        (["--dry-run", "--pilot", "oracle"], "oracle"),
        ([*MODEL, "--dry-run"], "http://127.0.0.1:9/picture.jpg"),
        (["--dry-run", "--pilot", "blind:ring"], "http://127.0.0.1:9/picture.jpg"),
    ):
        monkeypatch.chdir(tmp_path)
        assert main([*RIG, *words]) == 2, words
        captured = capsys.readouterr()
        assert re.search(parts, captured.err), captured.err
        assert len(captured.err.strip().splitlines()) == 1, words
        assert captured.out == "", words
        assert list(tmp_path.iterdir()) == [], words


def test_earlier_measurements_are_never_overwritten(capsys, tmp_path):
    (tmp_path / "chain.csv").write_text("step\n")
    assert main([*RIG, "--dry-run", "--pilot", "blind:ring", "--out", str(tmp_path)]) == 2
    assert "--out" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["chain.csv"]


def test_study_rate_has_the_same_spec_as_a_dry_run_of_fly():
    more = [*MODEL, "--dry-run", "--patience", "9", "--instruction", "Go.", "--seconds", "20", "--agent", "steady"]
    spec = spec_of(parse(["fly", *RIG[2:], *more]))
    assert study_rate.rehearsal(parse([*RIG, *more])) == spec
    assert spec.connected
    assert spec.connected.authority == Authority(arm=False, then="hold", dry=True)
