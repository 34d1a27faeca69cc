"""The digest of what decides a flight: of what sources say, not of where they stand or how they are explained.

A Python source is the set of its top-level statements, without imports, docstrings, comments and `__version__`, so a
function that moves to another file stays what it is. The path of one of our modules counts as `a module`, wherever it
is written. A TOML file is its values, any other file its bytes. File names and the order of statements do not count.
"""

import ast
import contextlib
import hashlib
import json
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from foundation.errors import UsageError
from foundation.files import write_text
from foundation.machine import user_cache

OUR_MODULE = re.compile(r"(foundation|vehicles|autopilot|episodes|hil|dronecats)(\.[a-z_0-9]+)+(:\w+)?")
MODULUS = 1 << 256
KEPT_MOST = 5000  # files in the cache, beyond which those of other versions are forgotten
PARENTS = "parents"  # how far up a module looks for the root changes with its place


def digest(paths: Sequence[Path]) -> str:
    """Return the SHA-256, in hexadecimal, of what these files say.

    Parsing hundreds of files takes seconds: what each says is kept in the user's cache under a digest of its bytes.
    """
    kept, read = _kept(), dict[str, int]()
    for path in paths:
        data = path.read_bytes()
        name = hashlib.sha256(path.suffix.encode() + data).hexdigest()
        read[name] = kept[name] if name in kept else statements(path.suffix, data)
    if not read.keys() <= kept.keys():
        _keep(read if len(kept) > KEPT_MOST else kept | read)
    total = sum(read.values()) % MODULUS
    return hashlib.sha256(total.to_bytes(32, "big")).hexdigest()


def statements(suffix: str, data: bytes) -> int:
    """Return the sum of the digests of all that a file says, so that no order of statements or files matters."""
    if suffix == ".py":
        chunks = ["\0".join(words).encode() for node in ast.parse(data).body if (words := list(_tokens(node)))]
    elif suffix == ".toml":
        chunks = [json.dumps(tomllib.loads(data.decode()), sort_keys=True, default=str).encode()]
    else:
        chunks = [data]
    return sum(int.from_bytes(hashlib.sha256(chunk).digest(), "big") for chunk in chunks) % MODULUS


def _tokens(value: Any) -> Iterator[str]:
    """Yield a statement as words; none for an import or a docstring."""
    if isinstance(value, ast.Import | ast.ImportFrom) or _is_docstring(value) or _is_version(value):
        return
    if isinstance(value, ast.Constant) and isinstance(value.value, str) and OUR_MODULE.fullmatch(value.value):
        yield "a module"
    elif isinstance(value, ast.Subscript) and isinstance(value.value, ast.Attribute) and value.value.attr == PARENTS:
        yield PARENTS
    elif isinstance(value, ast.AST):
        yield type(value).__name__
        for name, part in ast.iter_fields(value):
            if part is not None and part != []:  # what newer versions of Python add is empty here
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


def _kept() -> dict[str, int]:
    """Return what has been parsed before: a file's digest and what it says."""
    with contextlib.suppress(UsageError, OSError, ValueError, TypeError, AttributeError):
        return {name: int(value, 16) for name, value in json.loads(_cache().read_bytes()).items()}
    return {}


def _keep(read: dict[str, int]) -> None:
    with contextlib.suppress(UsageError, OSError):
        path = _cache()
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps({name: f"{value:x}" for name, value in read.items()}))


def _cache() -> Path:
    return user_cache() / "identity" / "statements.json"
