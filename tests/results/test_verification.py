"""An archive that was changed is found out."""

import pytest

from dronecats.metrics.judging import reread
from dronecats.results.archive.verification import verify
from foundation.errors import UsageError
from tests.results.archives import TWO, changed, in_manifest


def line_of(files: dict[str, bytes], name: str, old: str, new: str) -> None:
    home = f"runs/01/{TWO[0]}/{name}" if name != "run.json" else "runs/01/run.json"
    assert old.encode() in files[home]
    files[home] = files[home].replace(old.encode(), new.encode(), 1)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: line_of(f, "verdict.json", '"success": true', '"success": false'), "verdict.json in success"),
        (lambda f: line_of(f, "truth.jsonl", '"distance_m": 1.5', '"distance_m": 9.5'), "verdict differs from"),
        (lambda f: line_of(f, "decisions.jsonl", '\\"go\\"', '\\"fly\\"'), "does not say the action"),
        (lambda f: line_of(f, "episode.json", '"yaw_deg": 1', '"yaw_deg": '), "not the one that ships"),
        (lambda f: line_of(f, "episode.json", "{", "[{"), "not valid JSON"),
        (lambda f: f.pop(f"runs/01/{TWO[0]}/verdict.json"), "there is no verdict.json"),
        (lambda f: line_of(f, "run.json", '"fixed:0.5"', '"fixed:0.1"'), "under other settings"),
        (lambda f: line_of(f, "run.json", '"seed": 0', '"seed": 3'), "another seed"),
        (lambda f: line_of(f, "run.json", '"replay": null', '"replay": {}'), "flown again"),
        (lambda f: in_manifest(f, partial=None), "not marked as partial"),
        (lambda f: in_manifest(f, pilot="openai/gpt-5", is_model=True), "is said to be flown by openai/gpt-5"),
    ],
)  # fmt: skip
def test_what_was_changed_is_found(change, said, small, tmp_path):
    told = verify(changed(small, tmp_path / "x.tar.xz", change), reread)
    assert not told.verified
    assert said in " ".join(told.differences)


def test_a_file_that_is_not_its_digests_is_named(small, tmp_path):
    name = f"runs/01/{TWO[0]}/truth.jsonl"
    forged = changed(
        small, tmp_path / "x.tar.xz", lambda f: f.update({name: f[name].replace(b"true", b"True")}), digests=False
    )
    assert f"{name} is not the file whose digest manifest.json holds" in verify(forged, reread).differences


def test_a_file_of_another_size_is_refused_before_it_is_read(small, tmp_path):
    name = f"runs/01/{TWO[0]}/truth.jsonl"
    forged = changed(small, tmp_path / "x.tar.xz", lambda f: f.update({name: f[name] + b"\n"}), digests=False)
    with pytest.raises(UsageError, match=r"truth\.jsonl' is not as its manifest"):
        verify(forged, reread)


def test_what_a_terminal_would_obey_is_not_handed_on(small, tmp_path):
    forged = changed(small, tmp_path / "x.tar.xz", lambda f: line_of(f, "episode.json", '"id": "', '"id": "\\u001b[2J'))
    told = verify(forged, reread)
    assert told.differences
    assert all(said.isprintable() for said in told.differences)
