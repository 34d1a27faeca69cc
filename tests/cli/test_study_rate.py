"""`dronecats study rate` as it is typed: what is refused, each in one sentence, before anything is sent."""

import pytest

from dronecats.cli import study_rate
from dronecats.cli.fly_spec import spec_of
from dronecats.cli.main import main, parse
from dronecats.flight.spec import Authority

RIG = ["study", "rate", "--connect", "udpin://127.0.0.1:14599", "--camera", "http://127.0.0.1:9/picture.jpg"]
MODEL = ["--model", "local/m", "--base-url", "http://127.0.0.1:9/v1"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (MODEL, "`study rate` never moves a vehicle; so that it is clear to everybody, add --dry-run"),
        ([*MODEL, "--dry-run", "--questions", "4"], "--questions wants a whole number from 5 to 10,000, got 4"),
        ([*MODEL, "--dry-run", "--seconds", "-1"], "--seconds wants more than 0 and at most 300, got -1"),
        ([*MODEL, "--dry-run", "--cache", "kept"], "a reply that was kept takes no time: leave --cache out"),
        ([*MODEL, "--dry-run", "--pilot", "vision"], "choose one pilot: --pilot NAME or --model PROVIDER/NAME"),
        (["--dry-run", "--model", "replay:runs/x"], "--model replay:RUN goes with --sitl"),
        (["--dry-run", "--pilot", "oracle"], "the pilot oracle needs the truth"),
        ([*MODEL, "--dry-run"], "the model endpoint http://127.0.0.1:9/v1 cannot be reached"),
        (["--dry-run", "--pilot", "blind:ring"], "the camera at http://127.0.0.1:9/picture.jpg gives no frame"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*RIG, *words]) == 2
    heard = capsys.readouterr()
    assert said in heard.err
    assert len(heard.err.strip().splitlines()) == 1
    assert heard.out == ""
    assert list(tmp_path.iterdir()) == []


def test_what_was_measured_before_is_never_written_over(capsys, tmp_path):
    (tmp_path / "chain.csv").write_text("step\n")
    assert main([*RIG, "--dry-run", "--pilot", "blind:ring", "--out", str(tmp_path)]) == 2
    assert "already holds a chain that was measured; choose another --out" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["chain.csv"]


def test_it_is_the_rehearsal_of_fly_word_for_word():
    more = [*MODEL, "--dry-run", "--patience", "9", "--instruction", "Go.", "--seconds", "20", "--agent", "steady"]
    flown = spec_of(parse(["fly", *RIG[2:], *more]))
    assert study_rate.rehearsal(parse([*RIG, *more])) == flown
    assert flown.connected
    assert flown.connected.authority == Authority(arm=False, then="hold", dry=True)
