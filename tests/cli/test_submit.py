"""The commands `dronecats submit`, `verify` and `leaderboard`."""

import json
import re

import pytest

from dronecats.cli.main import main
from episodes.records import catalogue
from tests.report.results.synthetic_runs import write_run

TWO = tuple(catalogue.suite_ids("quick"))[:2]


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "run", TWO)
    return tmp_path


def test_submit_verify_and_leaderboard_turn_a_run_into_a_page(place, capsys, monkeypatch):
    monkeypatch.setenv("SOME_API_KEY", "residential-secret-77")
    assert main(["submit", "run", "--out", "a.tar.xz", "--partial", "--note", "residential-secret-77 was here"]) == 0
    output = capsys.readouterr().out
    assert re.search(r"\b10 .*\b12 .*quick", output)
    assert "truth.jsonl" in output
    assert main(["verify", "a.tar.xz", "--json"]) == 0
    entry = capsys.readouterr().out
    assert json.loads(entry)["note"] == "*** was here"
    assert "residential-secret" not in entry
    (place / "a.json").write_text(entry)
    assert main(["leaderboard", "a.json", "--out", "page.md"]) == 0
    page = (place / "page.md").read_text()
    assert main(["leaderboard", "a.tar.xz"]) == 0  # from the archive, which it verifies first
    assert capsys.readouterr().out == page
    assert "[oracle](#oracle-" in page
    assert sorted(path.name for path in place.iterdir()) == ["a.json", "a.tar.xz", "page.md", "run"]


def test_a_forged_archive_exits_with_4_and_a_damaged_archive_with_2(place, capsys):
    assert main(["submit", "run", "--out", "a.tar.xz", "--partial"]) == 0
    data = bytearray((place / "a.tar.xz").read_bytes())
    from tests.report.results.archives import changed, in_manifest

    forged = changed(place / "a.tar.xz", place / "b.tar.xz", lambda files: in_manifest(files, pilot="gemini/x"))
    capsys.readouterr()
    assert main(["verify", str(forged)]) == 4
    assert "gemini/x" in capsys.readouterr().out
    assert main(["leaderboard", str(forged)]) == 2
    data[len(data) // 2] ^= 0xFF
    (place / "c.tar.xz").write_bytes(data)
    assert main(["verify", "c.tar.xz"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_archives_that_would_fail_verification_are_not_written(place, capsys):
    verdict = place / "run" / TWO[0] / "verdict.json"
    verdict.write_text(verdict.read_text().replace('"success": true', '"success": false'))
    assert main(["submit", "run", "--out", "a.tar.xz", "--partial"]) == 2
    assert "runs/01/" in capsys.readouterr().err
    assert [path.name for path in place.iterdir()] == ["run"]


def test_wrong_usage_is_one_sentence(place, capsys):
    for arguments, expected in (
        (["submit", "run", "--out", "a.zip"], ".tar.xz"),
        (["submit", "run", "--out", "a.tar.xz"], "--partial"),
        (["submit", "nowhere", "--out", "a.tar.xz"], "nowhere"),
        (["submit", "run", "--out", "no/where/a.tar.xz", "--partial"], "No such file"),
        (["submit", "run", "--out", "a.tar.xz", "--partial", "--name", "x" * 81], "--name"),
        (["verify", "nowhere"], "nowhere"),
        (["verify", "run"], "run"),
        (["verify", "run/run.json"], "run/run.json"),
        (["leaderboard", "run/run.json"], "run/run.json"),
        (["leaderboard", "nowhere.json"], "nowhere.json"),
    ):
        assert main(arguments) == 2, arguments
        error = capsys.readouterr().err.strip()
        assert expected in error, arguments
        assert len(error.splitlines()) == 1, arguments
        assert not list(place.glob("a.*")), arguments
