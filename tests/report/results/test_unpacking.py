"""Tests that malicious or damaged archives are rejected in one sentence and write nothing outside their folder."""

import copy
import io
import json
import lzma
import re
import shutil
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.report.leaderboard import archive_file as tar
from dronecats.report.leaderboard import archive_file as unpacking
from dronecats.report.leaderboard import verification
from dronecats.report.leaderboard.archive_file import decoded
from dronecats.report.leaderboard.leaderboard import page
from dronecats.report.leaderboard.submission import digest
from dronecats.report.leaderboard.verification import verify
from foundation.conversion import decode
from foundation.errors import UsageError
from tests.report.results.archives import QUICK, TWO, changed, contents, in_manifest, packed


def raw(out: Path, *entries: tarfile.TarInfo, format: int = tarfile.USTAR_FORMAT) -> Path:
    with lzma.open(out, "wb") as file, tarfile.open(fileobj=file, mode="w", format=format) as opened:
        for entry in entries:
            opened.addfile(entry, io.BytesIO(b"x" * entry.size) if entry.isreg() else None)
    return out


def info(name: str, kind: bytes = tarfile.REGTYPE, size: int = 0, link: str = "") -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.type, entry.size, entry.linkname = kind, size, link
    return entry


STRANGE = (
    "../evil", "/etc/evil", "runs/01/../../evil/truth.jsonl", "runs/01/a/../truth.jsonl", "runs/1/run.json",
    f"runs/01/{TWO[0]}/frames/../../../../../evil.jpg", f"runs/01/{TWO[0]}/../../../../evil", "runs/01/A/truth.jsonl",
    f"runs/01/{TWO[0]}/ledger.sqlite", f"runs/01/{TWO[0]}/truth.jsonl/", f"runs/01/{TWO[0]}/commander.jsonl\n",
    f"runs/01/{TWO[0]}/frames/evil.jpg", "runs/٠١/run.json", "manifest.json",
)  # fmt: skip


def test_file_names_outside_the_run_layout_are_rejected(small, tmp_path):
    """Tests both cases: the manifest lists the name, or only the archive has it."""
    place = tmp_path / "place"
    place.mkdir()
    files = contents(small)
    for name in STRANGE:
        forged_manifest = json.loads(files["manifest.json"])
        forged_manifest["files"][name] = {"bytes": 4, "sha256": digest(b"evil").sha256}
        for manifest in (forged_manifest, json.loads(files["manifest.json"])):
            forged = tmp_path / "x.tar.xz"
            entries = {**files, "manifest.json": json.dumps(manifest).encode()}
            with (
                lzma.open(forged, "wb", preset=0) as file,
                tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as opened,
            ):
                for entry_name, data in [*entries.items(), (name, b"evil")]:
                    opened.addfile(info(entry_name, size=len(data)), io.BytesIO(data))
            with forged.open("rb") as file, pytest.raises(UsageError):
                unpacking.unpack(file, place)
            assert not list(tmp_path.rglob("*evil*")), name
            assert sorted(path.name for path in tmp_path.iterdir()) == ["place", "x.tar.xz"], name
            shutil.rmtree(place)
            place.mkdir()


def test_entries_other_than_plain_files_are_rejected(small, tmp_path):
    files = contents(small)
    manifest = info("manifest.json", size=len(files["manifest.json"]))
    for kind in (
        tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.DIRTYPE, tarfile.FIFOTYPE, tarfile.CHRTYPE, tarfile.GNUTYPE_SPARSE,
    ):  # fmt: skip
        with lzma.open(tmp_path / "x.tar.xz", "wb") as file, tarfile.open(fileobj=file, mode="w") as opened:
            opened.addfile(manifest, io.BytesIO(files["manifest.json"]))
            opened.addfile(info("runs/01/run.json", kind, link="/etc/passwd"))
        with pytest.raises(UsageError, match="plain file"):
            verify(tmp_path / "x.tar.xz")


def test_pax_and_gnu_headers_are_rejected(tmp_path):
    entry = info("manifest.json", size=3)
    entry.pax_headers = {"path": "../../evil"}
    with pytest.raises(UsageError, match="plain file"):
        verify(raw(tmp_path / "x.tar.xz", entry, format=tarfile.PAX_FORMAT))
    with pytest.raises(UsageError, match=r"x\.tar\.xz.* tar file"):
        verify(raw(tmp_path / "x.tar.xz", info("a" * 300, size=3), format=tarfile.GNU_FORMAT))


def test_decompression_bombs_are_rejected(small, tmp_path, monkeypatch):
    bomb = tmp_path / "bomb.tar.xz"
    with lzma.open(bomb, "wb", preset=0) as file:
        file.write(b"\0" * (16 << 20))
    with pytest.raises(UsageError, match="not an archive"):  # only the first block is unpacked
        verify(bomb)

    def grown(files):
        manifest = json.loads(files["manifest.json"])
        manifest["files"][f"runs/01/{TWO[0]}/truth.jsonl"]["bytes"] = unpacking.LOG_MAX + 1
        files["manifest.json"] = json.dumps(manifest).encode()

    with pytest.raises(UsageError, match=r"truth\.jsonl.* large"):
        verify(changed(small, tmp_path / "x.tar.xz", grown, digests=False))
    monkeypatch.setattr(tar, "TOTAL_MAX", 4096)
    with pytest.raises(UsageError, match="more data"):
        verify(small)


def test_a_high_compression_ratio_is_rejected(small, tmp_path):
    with lzma.open(tmp_path / "x.tar.xz", "wb", preset=1) as out, lzma.open(small) as archive:
        out.write(archive.read())
        for _ in range(100):
            out.write(b"\0" * (1 << 20))
    with pytest.raises(UsageError, match="more data"):
        verify(tmp_path / "x.tar.xz")


def test_a_large_lzma_dictionary_is_rejected(tmp_path):
    filters = [{"id": lzma.FILTER_LZMA2, "preset": 0, "dict_size": 1 << 29}]
    xz = lzma.LZMACompressor(format=lzma.FORMAT_XZ, filters=filters)
    (tmp_path / "x.tar.xz").write_bytes(xz.compress(b"\0" * 100) + xz.flush())
    with pytest.raises(UsageError, match="memory"):
        verify(tmp_path / "x.tar.xz")


# (the change to an archive, a pattern that the message contains)
FORGED: list[tuple[Callable[[dict[str, bytes]], object], str]] = [
    (lambda f: f.pop("runs/01/run.json"), "runs/01/run.json"),
    (lambda f: f.update({"runs/02/run.json": b"{}"}), "runs/02/run.json"),
    (lambda f: f.update({f"runs/01/{QUICK[5]}/truth.jsonl": b""}), f"runs/01/{QUICK[5]}/truth.jsonl"),
    (lambda f: f.update({"runs/01/run.json": b"[]"}), "01/run.json"),
    (lambda f: f.update({"runs/01/run.json": b'{"flight": [1], "versions": {}}'}), "$.flight"),
    (lambda f: f.update({"runs/01/run.json": b'{"flight": {}, "versions": {}, "schema": 99}'}), "newer"),
    (lambda f: in_manifest(f, schema=2), "newer"),
    (lambda f: in_manifest(f, runs=[]), "twice"),
    (lambda f: in_manifest(f, name="\x1b[31m"), "manifest.json"),
    (lambda f: in_manifest(f, more=1), "'more'"),
    (lambda f: in_manifest(f, left_out={"/etc/x": {"bytes": 0, "sha256": "0" * 64}}), "/etc/x"),
]


def test_invalid_archives_are_rejected_in_one_sentence(small, tmp_path):
    for k, (change, part) in enumerate(FORGED):
        with pytest.raises(UsageError, match=re.escape(part)) as refused:
            verify(changed(small, tmp_path / f"{k}.tar.xz", change))
        assert len(str(refused.value).splitlines()) == 1, part


def test_files_that_are_not_archives_are_rejected(tmp_path):
    for data in (b"", b"x" * 1000, b"\x1f\x8b\x08" + b"\0" * 100):
        (tmp_path / "x.tar.xz").write_bytes(data)
        with pytest.raises(UsageError, match=r"x\.tar\.xz"):
            verify(tmp_path / "x.tar.xz")
    with pytest.raises(UsageError, match="nowhere"):
        verify(tmp_path / "nowhere")


def test_data_after_the_end_of_the_archive_is_rejected(small, tmp_path):
    (tmp_path / "x").write_bytes(small.read_bytes() + small.read_bytes())
    with pytest.raises(UsageError, match="after its end"):
        verify(tmp_path / "x")


def refusal(call: Callable[[], object]) -> str:
    """Return the message of the UsageError that a call raises, or an empty text."""
    try:
        call()
    except UsageError as refused:
        return str(refused)
    return ""


SMALL: dict[Path, bytes] = {}


@given(data=st.data())
def test_a_damaged_archive_is_rejected_or_read_and_writes_only_to_its_folder(data, small, tmp_path_factory):
    original = SMALL.setdefault(small, lzma.decompress(small.read_bytes()))
    damaged = bytearray(original)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1) | st.integers(0, 1535))
        damaged[at] = data.draw(st.integers(0, 255))
    damaged = damaged[: data.draw(st.sampled_from([len(damaged), len(damaged) // 2, 512, 0]))]
    home = tmp_path_factory.mktemp("fuzz")
    place = home / "place"
    place.mkdir()
    message = refusal(lambda: unpacking.unpack(io.BytesIO(lzma.compress(bytes(damaged), preset=0)), place))
    assert len(message.splitlines()) <= 1
    assert [path.name for path in home.iterdir()] == ["place"]
    for path in place.rglob("*"):
        assert path.resolve().is_relative_to(place.resolve())


@given(st.binary(max_size=300))
def test_random_manifest_bytes_are_rejected_in_one_line(data):
    assert len(refusal(lambda: decoded(data)).splitlines()) == 1


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=5) | st.floats(allow_nan=False),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(data=st.data())
def test_any_manifest_value_is_read_or_rejected_in_one_line(data, small):
    manifest = json.loads(contents_once(small)["manifest.json"])
    keys = data.draw(st.lists(st.sampled_from(sorted(manifest)), min_size=1, max_size=2))
    for key in keys:
        manifest[key] = data.draw(VALUES)
    assert len(refusal(lambda: decoded(json.dumps(manifest).encode())).splitlines()) <= 1


STRANGE_VALUES = VALUES | st.sampled_from(
    [10**30, 10**400, -1, 1e308, "\ud800", "\x1b[2J", "x" * 5000, "[" * 3000, {"a": {"b": [10**30]}}, [[]] * 3]
)


@settings(max_examples=25)
@given(data=st.data())
def test_no_value_in_a_file_breaks_the_verification(data, small, tmp_path_factory):
    """Any archive is rejected in one sentence or judged. Its report can be printed and encoded."""
    files = contents_once(small)
    name = data.draw(st.sampled_from([file_name for file_name in files if file_name != "manifest.json"]))
    lines = files[name].split(b"\n") if name.endswith(".jsonl") else [files[name]]
    at = data.draw(st.integers(0, max(0, len(lines) - 2)))
    value = json.loads(lines[at])
    place = value
    while isinstance(place, dict) and place:  # a field of the row, or of an object in it
        key = data.draw(st.sampled_from(sorted(place)))
        if not (isinstance(place[key], dict) and place[key] and data.draw(st.booleans())):
            place[key] = data.draw(STRANGE_VALUES)
            break
        place = place[key]
    lines[at] = json.dumps(value).encode()
    forged = packed({**files, name: b"\n".join(lines)}, tmp_path_factory.mktemp("values") / "x.tar.xz")
    reports: list[verification.Verification] = []
    message = refusal(lambda: reports.append(verify(forged)))
    assert len(message.splitlines()) <= 1
    for report in reports:
        assert decode(msgspec.json.encode(report), verification.Verification) == report
        page([replace(report, verified=True)])


CONTENTS: dict[Path, dict[str, bytes]] = {}


def contents_once(archive: Path) -> dict[str, bytes]:
    return copy.copy(CONTENTS.setdefault(archive, contents(archive)))
