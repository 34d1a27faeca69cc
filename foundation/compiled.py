"""`njit` for every kernel of the project, with a cache on disk that no edit can outdate.

numba's own cache notices a change in the file of the outermost function only: after an update of `vehicles/rotor.py`,
a cached `vehicles.multirotor.step` would go on flying the old rotor. So the cache lives in a folder named after the
sources of all kernels.
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
# in a kernel's signature:
Record = Any  # a numpy record, its fields as attributes; the argument's name tells its dtype
Grid = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
# where kernels live, and the constants and records that they are compiled with; tests/architecture holds it complete
SOURCES = (
    "vehicles/*.py",
    "autopilot/*.py",
    "autopilot/control/*.py",
    "autopilot/estimator/*.py",
    "episodes/camera/renderer/*.py",
    "episodes/maps/scene.py",
    "foundation/*.py",
    "dronecats/flight/sitl/fused.py",
    "dronecats/study/loop/feedback.py",
)
KEPT_S = 30 * 86_400  # s, a cache of sources that nobody has run for so long is removed


def digest() -> str:
    """Return a name for the present state of every source that kernels are compiled from."""
    state = hashlib.sha256(numba.__version__.encode())
    for path in sources():
        state.update(str(path.relative_to(ROOT)).encode())
        state.update(path.read_bytes())
    return state.hexdigest()[:16]


def sources() -> list[Path]:
    """Return the files that a compiled kernel may depend on."""
    return [path for pattern in SOURCES for path in sorted(ROOT.glob(pattern))]


def cache_folder() -> Path:
    """Return where compiled kernels are kept: below NUMBA_CACHE_DIR, or the user's cache folder. Raises UsageError."""
    return user_cache() / digest()


def _prepare() -> bool:
    """Point numba at the folder and return whether it can be written to.

    At import, since a decorator reads it when it is applied.
    """
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
    with contextlib.suppress(OSError):  # another process may be tidying up, too
        os.utime(folder)
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other, ignore_errors=True)
    return True


@contextlib.contextmanager
def in_turn() -> Iterator[None]:
    """Let one process at a time compile, so that those that come after it read what it has left in the cache."""
    if not KEEPS:
        yield
        return
    with (cache_folder() / "turn").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)  # given back when it is closed, however that comes about
        yield


class Kernel(Protocol[P, R]):
    """A function as numba keeps it: called like its source, and compiled at the first call or when asked to."""

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R: ...

    def compile(self, sig: tuple[numba.types.Type, ...]) -> object:
        """Compile it for arguments of these types and leave it in the cache."""


def njit(*, cache: bool = True, **options: Any) -> Callable[[Callable[P, R]], Kernel[P, R]]:
    """Return the decorator `numba.njit(…)`, which caches where that can be; signatures stay for the type checker.


    Without a folder that can be written to nothing is cached, and each start compiles: numba would keep its work beside
    the sources instead, where an update outdates it, or refuse where they are read-only.
    Without the wrapper by which C code would call a kernel: nobody does, and it takes a tenth of the compile time.
    """
    compiled: Callable[[Callable[P, R]], Kernel[P, R]] = numba.njit(
        **{"cache": cache and KEEPS, "no_cfunc_wrapper": True, **options}
    )
    return compiled


prange = numba.prange
KEEPS = _prepare()  # whether what is compiled is kept for the next start
