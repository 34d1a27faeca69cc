"""Caches slowly computed values, which depend only on sources, libraries and an input, in the user's cache folder."""

import contextlib
import hashlib
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

from foundation.errors import UsageError
from foundation.files import whole_file
from foundation.machine import user_cache

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "numba")  # their arithmetic may differ between versions
# Storing a value removes old files with its `name`: all but the FILES_MAX last used ones, and files that were not used
# for KEPT_S (s).
FILES_MAX, KEPT_S = 8, 7 * 86_400.0
T = TypeVar("T")


def kept(name: str, sources: Iterable[str], make: Callable[[], T], of: object = None) -> T:
    """Return the value of `make()`. Read it from the cache if it was stored for the same sources and input `of`.

    `name`: start of the file's name. `sources`: patterns of files below ROOT. `of`: the input from which
    `make` computes the value. Value and input must consist of plain types, arrays and the project's classes. Without a
    usable cache, `make` is called every time.
    """
    try:
        folder = user_cache() / "values"
    except UsageError:
        return make()
    file = folder / f"{name}.{digest(sources, of)}"
    with contextlib.suppress(Exception):  # a damaged pickle may raise any exception
        value: T = pickle.loads(file.read_bytes())
        with contextlib.suppress(OSError):  # the folder may be read-only
            os.utime(file)
        return value
    value = make()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(file) as draft:
            draft.write_bytes(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))
        used_s = {other: other.stat().st_mtime for other in folder.glob(f"{name}.*")}
        for number, other in enumerate(sorted(used_s, key=lambda other: used_s[other], reverse=True)):
            if number >= FILES_MAX or time.time() - used_s[other] > KEPT_S:
                other.unlink()
    return value


def digest(sources: Iterable[str], of: object = None) -> str:
    """Return a digest of `of`, the files that match the patterns, and the versions of Python and LIBRARIES."""
    state = hashlib.sha256(repr((sys.version_info[:2], [version(library) for library in LIBRARIES])).encode())
    for path in (path for pattern in sources for path in sorted(ROOT.glob(pattern))):
        state.update(str(path.relative_to(ROOT)).encode())
        state.update(path.read_bytes())
    state.update(pickle.dumps(of, pickle.HIGHEST_PROTOCOL))
    return state.hexdigest()[:16]
