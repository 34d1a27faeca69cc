"""Helpers that unpack, change and repack archives, as a forger would."""

import json
import tarfile
from collections.abc import Callable
from pathlib import Path

from dronecats.report.leaderboard import archive_file as tar
from dronecats.report.leaderboard.submission import digest
from episodes.records import catalogue

QUICK = tuple(catalogue.suite_ids("quick"))
TWO = QUICK[:2]


def contents(archive: Path) -> dict[str, bytes]:
    with tarfile.open(archive) as opened:
        return {member.name: opened.extractfile(member).read() for member in opened}  # type: ignore[union-attr]


def packed(files: dict[str, bytes], out: Path, digests: bool = True) -> Path:
    """Write an archive of these files. With `digests`, the manifest gets correct digests."""
    files = dict(files)
    if digests:
        manifest = json.loads(files["manifest.json"])
        manifest["files"] = {
            name: {"bytes": len(data), "sha256": digest(data).sha256}
            for name, data in files.items()
            if name != "manifest.json"
        }
        files["manifest.json"] = json.dumps(manifest).encode()
    tar.write(out, [(name, lambda data=data: data) for name, data in files.items()])  # type: ignore[misc]
    return out


def changed(archive: Path, out: Path, change: Callable[[dict[str, bytes]], object], digests: bool = True) -> Path:
    files = contents(archive)
    change(files)
    return packed(files, out, digests)


def in_manifest(files: dict[str, bytes], **fields: object) -> None:
    files["manifest.json"] = json.dumps({**json.loads(files["manifest.json"]), **fields}).encode()
