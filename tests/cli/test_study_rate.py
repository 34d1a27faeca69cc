"""`dronecats study rate` as it is typed: what is refused, each in one sentence, before anything is sent."""

import re

from dronecats.cli import study_rate
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec.flight_spec import Authority

RIG = ["study", "rate", "--connect", "udpin://127.0.0.1:14599", "--camera", "http://127.0.0.1:9/picture.jpg"]
MODEL = ["--model", "local/m", "--base-url", "http://127.0.0.1:9/v1"]


def test_what_cannot_be_is_refused_in_one_sentence(capsys, tmp_path, monkeypatch):
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
        heard = capsys.readouterr()
        assert re.search(parts, heard.err), heard.err
        assert len(heard.err.strip().splitlines()) == 1, words
        assert heard.out == "", words
        assert list(tmp_path.iterdir()) == [], words


def test_what_was_measured_before_is_never_written_over(capsys, tmp_path):
    (tmp_path / "chain.csv").write_text("step\n")
    assert main([*RIG, "--dry-run", "--pilot", "blind:ring", "--out", str(tmp_path)]) == 2
    assert "--out" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["chain.csv"]


def test_it_is_the_rehearsal_of_fly_word_for_word():
    more = [*MODEL, "--dry-run", "--patience", "9", "--instruction", "Go.", "--seconds", "20", "--agent", "steady"]
    flown = spec_of(parse(["fly", *RIG[2:], *more]))
    assert study_rate.rehearsal(parse([*RIG, *more])) == flown
    assert flown.connected
    assert flown.connected.authority == Authority(arm=False, then="hold", dry=True)
