"""The digest of the sources that decide a flight. It depends on their statements, not on their places and comments.

A Python source counts as the set of its top-level statements, without imports, docstrings, comments and
`__version__`. So moving a function to another file does not change the digest. The path of one of our modules in a
string counts as `a module`. A TOML file counts as its values, any other file as its bytes. File names and the order of
statements do not count.
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
KEPT_MOST = 5000  # files in the cache; beyond it, files of other versions are dropped
PARENTS = "parents"  # the number of levels up to the root changes when a module moves


def digest(paths: Sequence[Path]) -> str:
    """Return the SHA-256, in hexadecimal, of the statements of these files.

    Parsing hundreds of files takes seconds, so the user's cache keeps the sum of each file under a digest of its bytes.
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
    """Return the sum of the digests of a file's statements. A sum does not depend on the order."""
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
            if part is not None and part != []:  # fields of newer Python versions are empty here
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
    """Return the cached sums: digest of a file's bytes → sum of its statements."""
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
