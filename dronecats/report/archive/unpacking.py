"""The logs of somebody's archive in a folder: plain files with a run's names, of bounded sizes, and nothing else."""

import hashlib
from pathlib import Path
from typing import BinaryIO

from dronecats.report.archive import tar
from dronecats.report.archive.manifest import FRAME, LOG, MANIFEST, Manifest, decoded
from foundation.errors import UsageError
from foundation.run_folder import layout

MANIFEST_MAX = 64 << 20  # bytes
LOG_MAX = 256 << 20
LOGS_MAX = 4 << 30  # of all logs together, which are unpacked
FRAME_MAX = 32 << 20


def unpack(file: BinaryIO, place: Path) -> tuple[Manifest, list[str], int]:
    """Unpack the logs of an archive into a folder.

    Returns its manifest, the files that are not what that says, a sentence each, and how many frames it held, which are
    read and not unpacked. Raises UsageError, OSError.
    """
    files = tar.read(file)
    first = next(files, None)
    if first is None or first.name != MANIFEST or first.size > MANIFEST_MAX:
        raise UsageError(f"it is no archive of runs: it does not begin with {MANIFEST}")
    manifest = decoded(b"".join(first.chunks()))
    _must_be_bounded(manifest)
    _must_be_of_the_runs(manifest)
    other: list[str] = []
    left, frames = dict(manifest.files), 0
    for packed in files:
        told = left.pop(packed.name, None)
        if told is None or told.bytes != packed.size:
            raise UsageError(f"{packed.name[:80]!r} is not as its {MANIFEST} says")
        if LOG.fullmatch(packed.name):
            sha256 = _unpacked(packed, place / packed.name)
        else:
            sha256, frames = _hashed(packed), frames + 1
        if sha256 != told.sha256:
            other.append(f"{packed.name} is not the file whose digest {MANIFEST} holds")
    if left:
        raise UsageError(f"{next(iter(left))!r} is in its {MANIFEST} and not in the archive")
    return manifest, other, frames


def _unpacked(packed: tar.Packed, path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    sha256 = hashlib.sha256()
    with path.open("xb") as out:
        for chunk in packed.chunks():
            sha256.update(chunk)
            out.write(chunk)
    return sha256.hexdigest()


def _hashed(packed: tar.Packed) -> str:
    sha256 = hashlib.sha256()
    for chunk in packed.chunks():
        sha256.update(chunk)
    return sha256.hexdigest()


def _must_be_bounded(manifest: Manifest) -> None:
    logs = 0
    for name, told in manifest.files.items():
        most = FRAME_MAX if FRAME.fullmatch(name) else LOG_MAX
        logs += 0 if FRAME.fullmatch(name) else told.bytes
        if told.bytes > most or logs > LOGS_MAX:
            raise UsageError(f"{name!r} is larger than it can be")


def _must_be_of_the_runs(manifest: Manifest) -> None:
    """Raise UsageError unless the files are those of the runs that the manifest names: each log, and no other."""
    wanted = {f"{run.folder}/{layout.RUN}" for run in manifest.runs}
    homes = {f"{run.folder}/{episode}" for run in manifest.runs for episode in run.episodes}
    wanted |= {f"{home}/{log}" for home in homes for log in (layout.EPISODE, layout.DECISIONS, layout.TRUTH)}
    if len({run.folder for run in manifest.runs}) != len(manifest.runs) or not homes:
        raise UsageError(f"its {MANIFEST} names no run, or one twice")
    if absent := next(iter(sorted(wanted - manifest.files.keys())), None):
        raise UsageError(f"it lacks {absent}")
    for name in (*manifest.files, *manifest.left_out):
        home = "/".join(name.split("/")[:3])
        if name not in wanted and home not in homes:
            raise UsageError(f"{name!r} is of no run that its {MANIFEST} names")
