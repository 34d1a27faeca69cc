"""What an archive says of itself: whose flights, of which settings, and the digest of every file."""

import re
from dataclasses import dataclass, fields
from typing import Annotated

import msgspec
from msgspec import Meta

from foundation.errors import UsageError

SCHEMA = 1  # version of the archive; counts up when a field changes its meaning
MANIFEST = "manifest.json"
NAME_CHARS, NOTE_CHARS = 80, 500

_EPISODE = r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?"
_OF_RUN = r"runs/[0-9]{2}"
_OF_EPISODE = rf"{_OF_RUN}/{_EPISODE}"
LOGS = (
    "episode.json", "identity.json", "decisions.jsonl", "truth.jsonl", "verdict.json", "commander.jsonl",
    "estimate.jsonl",
)  # fmt: skip
LOG = re.compile(rf"{_OF_RUN}/run\.json|{_OF_EPISODE}/(?:{'|'.join(map(re.escape, LOGS))})")
FRAME = re.compile(rf"{_OF_EPISODE}/frames/[0-9]{{6,9}}(?:_d[0-9]{{1,3}})?\.jpg")
LEFT_OUT = re.compile(rf"{_OF_EPISODE}/(?:frames/|flight\.tlog)")
EPISODE_NAME = re.compile(_EPISODE)

Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
Name = Annotated[str, Meta(min_length=1, max_length=NAME_CHARS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FileDigest:
    """A file; or, where its name ends with /, a folder: the digest of what `sha256sum *` prints in it."""

    bytes: Annotated[int, Meta(ge=0)]
    sha256: Sha256
    files: Annotated[int, Meta(ge=0)] | None = None  # of a folder


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmittedRun:
    """One flight of each of its episodes."""

    folder: Annotated[str, Meta(pattern=f"^{_OF_RUN}$")]
    seed: int
    episodes: tuple[Annotated[str, Meta(pattern=f"^{_EPISODE}$")], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """manifest.json, the first file of an archive."""

    schema: int
    name: Name  # of the entry
    note: Annotated[str, Meta(max_length=NOTE_CHARS)]
    pilot: str  # built-in pilot, or PROVIDER/NAME of the model
    is_model: bool
    identity: Sha256  # of all that makes its flights of one kind (`dronecats.report.results.identity`)
    suite: str | None  # whose episodes each run has, all of them; None: of none
    partial: str | None  # what is missing or broken, a sentence; None: the suite is whole and scored
    runs: tuple[SubmittedRun, ...]
    files: dict[str, FileDigest]  # that follow
    left_out: dict[str, FileDigest]  # that stay where they were flown
    scrubbed: tuple[str, ...]  # files out of which a key or a machine's path was taken
    dronecats: str  # version that packed it

    def encoded(self) -> bytes:
        """Return it as its file."""
        return msgspec.json.format(msgspec.json.encode(self, order="deterministic"), indent=1) + b"\n"


def decoded(data: bytes) -> Manifest:
    """Return the manifest that a file holds. Raises UsageError."""
    try:
        told = msgspec.json.decode(data)
        version = told.get("schema") if isinstance(told, dict) else None
        if isinstance(version, int) and version > SCHEMA:
            raise UsageError(f"the archive is of a newer dronecats: version {version}, known is {SCHEMA}; update")
        made = msgspec.convert(told, Manifest)
        unknown = told.keys() - {each.name for each in fields(Manifest)}
    except (msgspec.DecodeError, UnicodeError, RecursionError) as wrong:
        raise UsageError(f"{MANIFEST} of the archive is damaged: {wrong}") from None
    if unknown:
        raise UsageError(f"{MANIFEST} of the archive is damaged: {sorted(unknown)[0][:40]!r} is not known")
    for said in (made.name, made.note, made.pilot, made.suite or "", made.partial or "", made.dronecats):
        if not said.isprintable():
            raise UsageError(f"{MANIFEST} of the archive is damaged: it holds what cannot be printed")
    for path in made.files:
        if not (LOG.fullmatch(path) or FRAME.fullmatch(path)):
            raise UsageError(f"the archive names {path[:80]!r}, which is no file of a run")
    for path in made.left_out:
        if not LEFT_OUT.fullmatch(path):
            raise UsageError(f"the archive names {path[:80]!r} as left out, which is no file of a run")
    return made
