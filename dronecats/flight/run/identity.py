"""The identity of a flight: digests of the sources that flew and judged it, the protocol, its record and frames.

Digests are SHA-256 in hexadecimal. A report does not pool flights whose digests differ (docs/run-folder.md).
"""

import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

import foundation
from dronecats.flight.run import source_digest
from foundation import protocol
from foundation.errors import UsageError
from foundation.files import write_json
from foundation.run_folder import layout
from foundation.run_folder.reading import exchanges, rows
from foundation.run_folder.rows import Decision, EpisodeIdentity
from foundation.run_folder.writing import as_json

ROOT = Path(foundation.__file__).resolve().parents[1]
SOURCES = (".py", ".toml", ".txt", ".npz")
FOLDERS = (
    *("foundation", "vehicles", "autopilot", "episodes", "hil", "dronecats/agent", "dronecats/pilots"),
    *(f"dronecats/flight/{name}" for name in ("logger", "processes", "run", "sitl", "spec", "stages")),
)
FITTING = "dronecats/pilots/fitting"  # makes the files that the built-in pilots ship with; no flight runs it
JUDGE = "dronecats/judge"  # without its subfolders: metrics and statistics do not affect a verdict


@cache
def code_digest() -> str:
    """Return the digest of every source that decides what is flown and how it is judged.

    The sources that start flights or read their results (command line, campaigns, metrics, reports) are not included,
    and neither are those that fit the pilots. The digest stays the same if a file moves or a comment changes: see
    `dronecats.flight.run.source_digest`.
    """
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")] + list((ROOT / JUDGE).iterdir())
    sources = [path for path in paths if not path.is_relative_to(ROOT / FITTING)]
    return source_digest.digest([path for path in sources if path.suffix in SOURCES])


def protocol_numbers() -> dict[str, float | str]:
    """Return the constants of `foundation.protocol` by name."""
    values: Mapping[str, object] = vars(protocol)
    return {
        name: value for name, value in sorted(values.items()) if name.isupper() and isinstance(value, float | int | str)
    }


def suite_digest(records: Iterable[tuple[str, str]]) -> str:
    """Return the digest of a suite: the pairs (id, record as its file would hold it) in the order of their ids."""
    state = hashlib.sha256()
    for name, text in sorted(records):
        state.update(f"{name} {hashlib.sha256(text.encode()).hexdigest()}\n".encode())
    return state.hexdigest()


def identify(folder: Path, pace: Mapping[str, float] | None = None) -> EpisodeIdentity:
    """Return the identity of the flight in an episode folder. Raises OSError.

    `pace` has the figures of RateKeeper for a flight in real time; None in lockstep.
    """
    pictures = sorted((folder / layout.FRAMES).glob("*.jpg"))
    frames = hashlib.sha256()
    for picture in pictures:
        frames.update(picture.read_bytes())
    record = folder / layout.EPISODE
    identity = EpisodeIdentity(
        code_sha256=code_digest(),
        record_sha256=hashlib.sha256(record.read_bytes()).hexdigest() if record.exists() else None,
        frames=len(pictures),
        frames_sha256=frames.hexdigest() if pictures else None,
        served=_served_models(folder),
        **({"pace": dict(pace)} if pace else {}),
    )
    return identity


def write_identity(folder: Path, pace: Mapping[str, float] | None = None) -> EpisodeIdentity:
    """Write identity.json and return what it holds. Raises OSError."""
    identity = identify(folder, pace)
    write_json(folder / layout.IDENTITY, as_json(identity))
    return identity


def _served_models(folder: Path) -> tuple[str, ...]:
    """Return the names under which vendors served the model, in the order of their first reply."""
    try:
        served = [decision.served for decision in rows(folder / layout.DECISIONS, Decision)]
        served += [exchange.served for exchange in exchanges(folder)]
    except UsageError:  # the verdict reports damaged files
        return ()
    return tuple(dict.fromkeys(name for name in served if isinstance(name, str)))
