"""Tests archives of runs: their content without keys or local paths, and the runs that `submit` rejects."""

import json
import re
from dataclasses import replace
from typing import Any

import pytest

from dronecats.agent.latency import LatencyPolicy
from dronecats.judge.statistics.shares import estimate_share, wilson
from dronecats.report.leaderboard.submission import digest, submit
from dronecats.report.leaderboard.verification import verify
from dronecats.report.recorded.run import recorded_runs
from foundation.errors import UsageError
from tests.report.results.archives import QUICK, TWO, changed, contents
from tests.report.results.synthetic_runs import write_run


def test_a_complete_suite_is_verified_and_lists_unchecked_items(suite_archive):
    report = verify(suite_archive)
    assert report.differences == ()
    assert report.verified
    assert (report.pilot, report.is_model, report.suite, report.partial, report.flights) == (
        "oracle",
        False,
        "quick",
        None,
        1,
    )
    scores = {cell: (score.successes, score.scored) for cell, score in report.cells.items()}
    assert scores == {**dict.fromkeys(("approaching", "searching", "tracking", "search-and-track"), (2, 2)),
                      "commanding": (4, 4)}  # fmt: skip
    assert any("truth.jsonl" in note for note in report.unchecked)


def test_equal_runs_give_equal_archive_bytes(run, suite_archive, tmp_path):
    submit(recorded_runs([run]), tmp_path / "again.tar.xz")
    assert (tmp_path / "again.tar.xz").read_bytes() == suite_archive.read_bytes()


def test_runs_with_different_seeds_are_one_entry(run, tmp_path):
    again = write_run(tmp_path / "second", QUICK, seed=7)
    manifest = submit(recorded_runs([again, run]), tmp_path / "two.tar.xz", name="Twice", note="a  note")
    assert [(run_entry.folder, run_entry.seed) for run_entry in manifest.runs] == [("runs/01", 0), ("runs/02", 7)]
    report = verify(tmp_path / "two.tar.xz")
    assert (report.name, report.note, report.flights, report.verified) == ("Twice", "a note", 2, True)
    assert report.cells["commanding"].scored == 8
    expected = estimate_share(
        [[True, True]] * len(QUICK)
    )  # two equal flights of an episode give the same interval as one
    assert report.interval == (expected.low, expected.high) == wilson(len(QUICK), len(QUICK))


def test_telemetry_and_frames_are_omitted_except_for_their_digests(tmp_path):
    run = write_run(tmp_path / "run", TWO)
    (run / TWO[0] / "flight.tlog").write_bytes(b"tlog")
    (run / TWO[0] / "frames").mkdir()
    for name in ("000000.jpg", "000001_d3.jpg"):
        (run / TWO[0] / "frames" / name).write_bytes(name.encode())
    out = tmp_path / "a.tar.xz"
    manifest = submit(recorded_runs([run]), out, partial=True)
    home = f"runs/01/{TWO[0]}"
    assert manifest.left_out[f"{home}/flight.tlog"] == digest(b"tlog")
    lines = "".join(f"{digest(n.encode()).sha256}  {n}\n" for n in ("000000.jpg", "000001_d3.jpg"))
    assert manifest.left_out[f"{home}/frames/"] == replace(digest(lines.encode()), bytes=23, files=2)
    assert not [name for name in contents(out) if name.endswith((".jpg", ".tlog"))]
    submit(recorded_runs([run]), out, partial=True, with_frames=True)
    assert contents(out)[f"{home}/frames/000001_d3.jpg"] == b"000001_d3.jpg"
    report = verify(out)
    assert report.verified
    assert "2 frames" in " ".join(report.unchecked)


def test_archives_contain_no_keys_and_no_local_paths(tmp_path):
    run = write_run(tmp_path / "some body" / "run", TWO)
    key, shaped = "planted/key+of-mine", "sk-proj-0123456789abcdefghij"
    record = json.loads((run / "run.json").read_text())
    record["flight"]["accounts"]["ledger"] = "/home/someone/ledger.sqlite"
    record["camera"] = {"url": f"http://user:{key}@camera/x?token=abcdefgh1234", "note": str(run / "x")}
    record["versions"]["hint"] = f"{shaped} and recorded:/mnt/data/replies.txt, file:///srv/a/b"
    (run / "run.json").write_text(json.dumps(record))
    log = run / TWO[0] / "decisions.jsonl"
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    lines[0]["error"] = f"Bearer {key} in {tmp_path}/some body/notes.txt"
    log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    out = tmp_path / "a.tar.xz"
    manifest = submit(recorded_runs([run]), out, partial=True, secrets=[key], note=f"with {key} of /opt/x/y")
    everything = "\n".join([*contents(out), *(data.decode() for data in contents(out).values())])
    for never in (
        key,
        "planted",
        shaped,
        "someone",
        "/mnt",
        "/srv",
        "/opt",
        str(tmp_path),
        "some body",
        "abcdefgh1234",
    ):
        assert never not in everything, never
    kept = json.loads(contents(out)["runs/01/run.json"])
    assert kept["flight"]["accounts"]["ledger"] == "ledger.sqlite"
    assert kept["versions"]["hint"] == "*** and recorded:replies.txt, b"
    assert set(manifest.scrubbed) == {"runs/01/run.json", f"runs/01/{TWO[0]}/decisions.jsonl"}
    report = verify(out)
    assert report.differences == ()
    assert any("2 files" in note for note in report.unchecked)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda run: write_run(run, TWO), "10 .* 12 .*quick"),
        (lambda run: write_run(run, ("campus-approaching-03",)), "79 .* 80 .*one-drone"),
        (lambda run: (write_run(run, QUICK), (run / QUICK[3] / "truth.jsonl").write_text("[]\n")), QUICK[3]),
        (lambda run: (write_run(run, QUICK), (run / QUICK[3]).rename(run / "mine")), "mine"),
    ],
)
def test_an_incomplete_submission_is_rejected_or_marked_partial(change, part, tmp_path):
    change(tmp_path / "run")
    with pytest.raises(UsageError, match=f"{part}.*--partial") as refused:
        submit(recorded_runs([tmp_path / "run"]), tmp_path / "a.tar.xz")
    assert len(str(refused.value).splitlines()) == 1
    assert not list(tmp_path.glob("*.xz*"))
    manifest = submit(recorded_runs([tmp_path / "run"]), tmp_path / "a.tar.xz", partial=True)
    assert manifest.partial is not None
    assert re.search(part, manifest.partial)
    assert verify(tmp_path / "a.tar.xz").partial == manifest.partial


def test_an_entry_must_have_one_pilot_and_one_configuration(tmp_path):
    cases: list[tuple[dict[str, Any], str]] = [
        ({"pilot": "blind"}, "pilot.*oracle.*blind"),
        ({"latency": LatencyPolicy.parse("fixed:9")}, r"latency.*fixed:0\.5.*fixed:9"),
        ({}, "seed 0"),
    ]
    for k, (settings, parts) in enumerate(cases):
        write_run(tmp_path / f"{k}" / "a", TWO)
        write_run(tmp_path / f"{k}" / "b", TWO, **settings)
        with pytest.raises(UsageError, match=parts):
            submit(recorded_runs([tmp_path / f"{k}"]), tmp_path / "x.tar.xz", partial=True)


FLOWN: dict[str, Any] = {
    "code_sha256": "a" * 64,
    "record_sha256": None,
    "frames": 0,
    "frames_sha256": None,
    "served": [],
}


@pytest.mark.parametrize(
    ("changed_fields", "parts"),
    [({"code_sha256": "b" * 64}, "code.*a{8}.*b{8}"), ({"served": ["openai/gpt-5-2026"]}, "model.*openai/gpt-5-2026")],
)
def test_runs_with_different_code_or_served_model_are_rejected(changed_fields, parts, tmp_path):
    for k, more in enumerate(({}, changed_fields)):
        run = write_run(tmp_path / f"run{k}", TWO, seed=k)
        for episode in TWO:
            (run / episode / "identity.json").write_text(json.dumps({**FLOWN, **more}))
    with pytest.raises(UsageError, match=parts):
        submit(recorded_runs([tmp_path]), tmp_path / "x.tar.xz", partial=True)


def test_the_served_model_is_archived_and_checked_against_the_manifest(tmp_path):
    run = write_run(tmp_path / "run", TWO)
    for episode in TWO:
        (run / episode / "identity.json").write_text(json.dumps({**FLOWN, "served": ["/data/models/qwen"]}))
    out = tmp_path / "a.tar.xz"
    submit(recorded_runs([run]), out, partial=True)
    name = f"runs/01/{TWO[0]}/identity.json"
    assert json.loads(contents(out)[name])["served"] == ["qwen"]
    assert verify(out).verified
    forged = changed(out, tmp_path / "b.tar.xz", lambda f: f.update({name: f[name].replace(b"qwen", b"gpt-5")}))
    assert re.search("runs/01 .*settings", " ".join(verify(forged).differences))
