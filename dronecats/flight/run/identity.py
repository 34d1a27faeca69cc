"""Computes the identity of a flight: digests of its source code, record and frames, and the protocol's constants.

Digests are SHA-256 in hexadecimal. A report does not combine runs with different digests of the code, and rejects
flights of one episode with different digests of the record.

The digest of the source code covers statements, not their places and comments. From a Python file it covers the
top-level statements, without imports, docstrings, comments and `__version__`. So moving a function to another file does
not change the digest. A string with the path of a project module is replaced by `a module`. From a TOML file the
digest covers the values, from other files the bytes. File names and the order of statements have no effect.
"""

import ast
import contextlib
import hashlib
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import foundation
from foundation import protocol
from foundation.errors import UsageError
from foundation.files import write_json, write_text
from foundation.machine import user_cache
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
FITTING = "dronecats/pilots/fitting"  # makes data files of the built-in pilots; no flight runs it
JUDGE = "dronecats/judge"  # without its subfolders: metrics and statistics do not affect a verdict
OUR_MODULE = re.compile(r"(foundation|vehicles|autopilot|episodes|hil|dronecats)(\.[a-z_0-9]+)+(:\w+)?")
MODULUS = 1 << 256  # digests are added modulo this number, because a sum does not depend on their order
CACHE_ENTRIES_MAX = 5000  # cached files; above this number, the cache keeps only the files of the newest digest
PARENTS = "parents"  # `Path.parents[n]` is digested without n, which changes when a module moves


@cache
def code_digest() -> str:
    """Return the digest of all source code that affects a flight or its verdict.

    It excludes the code that starts flights or reads their results (command line, campaigns, metrics, reports), and the
    code that fits the pilots. The digest stays the same if a file moves or a comment changes.
    """
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")] + list((ROOT / JUDGE).iterdir())
    sources = [path for path in paths if not path.is_relative_to(ROOT / FITTING)]
    return source_digest([path for path in sources if path.suffix in SOURCES])


def source_digest(paths: Sequence[Path]) -> str:
    """Return the SHA-256, in hexadecimal, of the statements of these files.

    Parsing hundreds of files takes seconds, so a cache maps the digest of each file's bytes to the sum of `statements`.
    """
    kept, read = _load_cache(), dict[str, int]()
    for path in paths:
        data = path.read_bytes()
        name = hashlib.sha256(path.suffix.encode() + data).hexdigest()
        read[name] = kept[name] if name in kept else statements(path.suffix, data)
    if not read.keys() <= kept.keys():
        _store_cache(read if len(kept) > CACHE_ENTRIES_MAX else kept | read)
    total = sum(read.values()) % MODULUS
    return hashlib.sha256(total.to_bytes(32, "big")).hexdigest()


def statements(suffix: str, data: bytes) -> int:
    """Return the sum of the digests of a file's statements. The order of the statements has no effect."""
    if suffix == ".py":
        chunks = ["\0".join(words).encode() for node in ast.parse(data).body if (words := list(_tokens(node)))]
    elif suffix == ".toml":
        chunks = [json.dumps(tomllib.loads(data.decode()), sort_keys=True, default=str).encode()]
    else:
        chunks = [data]
    return sum(int.from_bytes(hashlib.sha256(chunk).digest(), "big") for chunk in chunks) % MODULUS


def _tokens(value: Any) -> Iterator[str]:
    """Yield the tokens of a syntax tree; none for imports, docstrings and `__version__`."""
    if isinstance(value, ast.Import | ast.ImportFrom) or _is_docstring(value) or _is_version(value):
        return
    if isinstance(value, ast.Constant) and isinstance(value.value, str) and OUR_MODULE.fullmatch(value.value):
        yield "a module"
    elif isinstance(value, ast.Subscript) and isinstance(value.value, ast.Attribute) and value.value.attr == PARENTS:
        yield PARENTS
    elif isinstance(value, ast.AST):
        yield type(value).__name__
        for name, part in ast.iter_fields(value):
            if part is not None and part != []:  # a newer Python may add empty fields, which must not change the digest
                yield name
                yield from _tokens(part)
    elif isinstance(value, list):
        yield "["
        for part in value:
            yield from _tokens(part)
        yield "]"
    else:
        yield repr(value)


def _is_docstring(value: Any) -> bool:
    return isinstance(value, ast.Expr) and isinstance(value.value, ast.Constant) and isinstance(value.value.value, str)


def _is_version(value: Any) -> bool:
    names = value.targets if isinstance(value, ast.Assign) else ()
    return any(isinstance(name, ast.Name) and name.id == "__version__" for name in names)


def _load_cache() -> dict[str, int]:
    """Return the cache: digest of a file's bytes → sum that `statements` returned for the file."""
    with contextlib.suppress(UsageError, OSError, ValueError, TypeError, AttributeError):
        return {name: int(value, 16) for name, value in json.loads(_cache().read_bytes()).items()}
    return {}


def _store_cache(read: dict[str, int]) -> None:
    with contextlib.suppress(UsageError, OSError):
        path = _cache()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps({name: f"{value:x}" for name, value in read.items()}))


def _cache() -> Path:
    return user_cache() / "identity" / "statements.json"


def protocol_numbers() -> dict[str, float | str]:
    values: Mapping[str, object] = vars(protocol)
    return {
        name: value for name, value in sorted(values.items()) if name.isupper() and isinstance(value, float | int | str)
    }


def suite_digest(records: Iterable[tuple[str, str]]) -> str:
    """Return the digest of a suite: the pairs (id, text of its record file) in the order of the ids."""
    state = hashlib.sha256()
    for name, text in sorted(records):
        state.update(f"{name} {hashlib.sha256(text.encode()).hexdigest()}\n".encode())
    return state.hexdigest()


def write_identity(folder: Path, pace: Mapping[str, float] | None = None) -> EpisodeIdentity:
    """Write identity.json of the flight in an episode folder, and return its content. Raises OSError.

    `pace`: how well a flight kept real time (`RateKeeper.figures`); None in lockstep.
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
    write_json(folder / layout.IDENTITY, as_json(identity))
    return identity


def _served_models(folder: Path) -> tuple[str, ...]:
    """Return the names under which vendors served the model, in the order of the first replies."""
    try:
        served = [decision.served for decision in rows(folder / layout.DECISIONS, Decision)]
        served += [exchange.served for exchange in exchanges(folder)]
    except UsageError:  # the verdict reports damaged files
        return ()
    return tuple(dict.fromkeys(name for name in served if isinstance(name, str)))
