"""Changes to an archive are detected."""

import re
from collections.abc import Callable

import pytest

from dronecats.report.leaderboard.verification import verify
from foundation.errors import UsageError
from tests.report.results.archives import TWO, changed, in_manifest


def line_of(files: dict[str, bytes], name: str, old: str, new: str) -> None:
    home = f"runs/01/{TWO[0]}/{name}" if name != "run.json" else "runs/01/run.json"
    assert old.encode() in files[home]
    files[home] = files[home].replace(old.encode(), new.encode(), 1)


# (the change to an archive, a pattern that a difference matches)
FORGED: list[tuple[Callable[[dict[str, bytes]], object], str]] = [
    (lambda f: line_of(f, "verdict.json", '"success": true', '"success": false'), "verdict.json .*success"),
    (lambda f: line_of(f, "truth.jsonl", '"distance_m": 1.5', '"distance_m": 9.5'), "verdict.json"),
    (lambda f: line_of(f, "decisions.jsonl", '\\"go\\"', '\\"fly\\"'), "action"),
    (lambda f: line_of(f, "episode.json", '"yaw_deg": 1', '"yaw_deg": '), f"{TWO[0]}.*record"),
    (lambda f: line_of(f, "episode.json", "{", "[{"), "episode.json"),
    (lambda f: f.pop(f"runs/01/{TWO[0]}/verdict.json"), f"{TWO[0]}.*verdict.json"),
    (lambda f: line_of(f, "run.json", '"fixed:0.5"', '"fixed:0.1"'), "runs/01 .*settings"),
    (lambda f: line_of(f, "run.json", '"seed": 0', '"seed": 3'), "runs/01 .*seed"),
    (lambda f: line_of(f, "run.json", '"replay": null', '"replay": {}'), "runs/01 .*replay"),
    (lambda f: in_manifest(f, partial=None), "partial"),
    (lambda f: in_manifest(f, suite="all"), "suite all"),
    (lambda f: in_manifest(f, pilot="openai/gpt-5", is_model=True), "openai/gpt-5.*oracle"),
]  # fmt: skip


def test_changes_are_detected(small, tmp_path):
    for k, (change, part) in enumerate(FORGED):
        report = verify(changed(small, tmp_path / f"{k}.tar.xz", change))
        assert not report.verified, part
        assert re.search(part, " ".join(report.differences)), (part, report.differences)


def test_a_file_with_a_wrong_digest_is_named_in_the_differences(small, tmp_path):
    name = f"runs/01/{TWO[0]}/truth.jsonl"
    forged = changed(
        small, tmp_path / "x.tar.xz", lambda f: f.update({name: f[name].replace(b"true", b"True")}), digests=False
    )
    assert any(
        difference.startswith(f"{name} ") and "digest" in difference for difference in verify(forged).differences
    )


def test_a_file_with_a_wrong_size_is_an_error(small, tmp_path):
    name = f"runs/01/{TWO[0]}/truth.jsonl"
    forged = changed(small, tmp_path / "x.tar.xz", lambda f: f.update({name: f[name] + b"\n"}), digests=False)
    with pytest.raises(UsageError, match=rf"{name}.*manifest\.json"):
        verify(forged)


def test_terminal_escape_codes_are_removed_from_differences(small, tmp_path):
    forged = changed(small, tmp_path / "x.tar.xz", lambda f: line_of(f, "episode.json", '"id": "', '"id": "\\u001b[2J'))
    report = verify(forged)
    assert report.differences
    assert all(difference.isprintable() for difference in report.differences)
