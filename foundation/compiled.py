"""The `njit` decorator of all kernels (functions that numba compiles), with a cache on disk that is never out of date.

numba's own cache notices a change only in the file of the outermost function. After an edit of `vehicles/rotor.py`, a
cached `vehicles.multirotor.step` would use the old rotor. So the name of the cache folder is a digest of the sources of
all kernels.
"""

import contextlib
import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from foundation.errors import UsageError
from foundation.machine import user_cache

P = ParamSpec("P")
R = TypeVar("R", covariant=True)
# types in the signatures of kernels
Record = Any  # a numpy record with its fields as attributes; the name of the argument shows which dtype it has
Grid = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
# files with kernels, or with constants and records that kernels use; tests/architecture checks the list
SOURCES = (
    "vehicles/*.py",
    "autopilot/*.py",
    "autopilot/control/*.py",
    "autopilot/estimator/*.py",
    "episodes/camera/renderer/*.py",
    "episodes/maps/cutouts.py",
    "episodes/maps/scene.py",
    "episodes/world/rays.py",
    "foundation/*.py",
    "dronecats/flight/sitl/fused.py",
    "dronecats/study/loop/feedback.py",
)
CACHE_LIFETIME_S = 30 * 86_400  # s; a cache that is unused for longer is removed


def digest() -> str:
    """Return a digest of all sources that kernels are compiled from."""
    state = hashlib.sha256(numba.__version__.encode())
    for path in sources():
        state.update(str(path.relative_to(ROOT)).encode())
        state.update(path.read_bytes())
    return state.hexdigest()[:16]


def sources() -> list[Path]:
    """Return the files that a compiled kernel may depend on."""
    return [path for pattern in SOURCES for path in sorted(ROOT.glob(pattern))]


def cache_folder() -> Path:
    """Return the cache of compiled kernels, below NUMBA_CACHE_DIR or the user's cache folder. Raises UsageError."""
    return user_cache() / digest()


def _prepare() -> bool:
    """Set numba's cache folder; return whether it is writable. Runs at import, before the decorators of any kernel."""
    try:
        folder = cache_folder()
    except UsageError:
        return False
    numba.config.CACHE_DIR = str(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    with contextlib.suppress(OSError):  # another process may remove old caches at the same time
        os.utime(folder)
        for folder_entry in folder.parent.iterdir():
            if time.time() - folder_entry.stat().st_mtime > CACHE_LIFETIME_S:
                shutil.rmtree(folder_entry, ignore_errors=True)
    return True


@contextlib.contextmanager
def compile_lock() -> Iterator[None]:
    """Let one process compile at a time, so that other processes read the compiled code from the cache."""
    if not CAN_CACHE:
        yield
        return
    with (cache_folder() / "turn").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)  # released when the file is closed
        yield


class Kernel(Protocol[P, R]):
    """A function compiled by numba, at its first call or by `compile`."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R: ...

    def compile(self, sig: tuple[numba.types.Type, ...]) -> object:
        """Compile the kernel for these argument types and store it in the cache."""


def njit(*, cache: bool = True, allocates: bool = False, **options: Any) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Return the decorator `numba.njit(…)` with caching; it keeps signatures for the type checker.

    `allocates`: the kernel, or a kernel that it calls, creates an array. numba counts references only in this case.
    With reference counts, every view of an array (`a[k]`, a field of a named tuple) costs two locked instructions, and
    threads that share the array wait for each other. Short kernels would spend most of their time on this.

    Without a writable cache folder, each start of the program compiles again. A cache beside the sources, as numba has
    by default, gets out of date and fails if the sources are read-only. The wrapper for calls from C is omitted, which
    saves a tenth of the compile time. Division by zero is not checked and gives infinity or NaN, as in numpy.
    """
    defaults = {"cache": cache and CAN_CACHE, "no_cfunc_wrapper": True, "error_model": "numpy", "_nrt": allocates}
    compiled: Callable[[Callable[P, R]], Kernel[P, R]] = numba.njit(**{**defaults, **options})
    return compiled


prange = numba.prange
CAN_CACHE = _prepare()  # whether compiled code is cached for the next start
