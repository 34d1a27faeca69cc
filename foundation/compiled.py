"""`njit` for every kernel of the project, with a cache on disk that no edit can outdate.

numba's own cache notices a change in the file of the outermost function only: after an update of `vehicles/rotor.py`,
a cached `vehicles.multirotor.step` would go on flying the old rotor. So the cache lives in a folder named after the
sources of all kernels.
"""

import contextlib
import hashlib
import os
import shutil
import time
from pathlib import Path
from typing import Any

import numba

ROOT = Path(__file__).resolve().parents[1]
# where kernels live, and the constants and records that they are compiled with; tests/architecture holds it complete
SOURCES = (
    "vehicles/*.py",
    "autopilot/*.py",
    "autopilot/control/*.py",
    "episodes/render/*.py",
    "episodes/scene.py",
    "foundation/*.py",
    "dronecats/sitl/fused.py",
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
    """Return where compiled kernels are kept: below NUMBA_CACHE_DIR, or the user's cache folder."""
    base = os.environ.get("NUMBA_CACHE_DIR") or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(base) / "dronecats" / digest()


def _prepare() -> None:
    """Point numba at the folder. At import, since a decorator reads it when it is applied."""
    folder = cache_folder()
    with contextlib.suppress(OSError):  # a home that cannot be written costs the compilation each time, no more
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > KEPT_S:
                shutil.rmtree(other, ignore_errors=True)
    numba.config.CACHE_DIR = str(folder)


def njit(*args: Any, **options: Any) -> Any:
    """Return `numba.njit(…, cache=True)`; usable with and without arguments.

    Without the wrapper by which C code would call a kernel: nobody does, and it takes a tenth of the compile time.
    """
    return numba.njit(*args, **{"cache": True, "no_cfunc_wrapper": True, **options})


prange = numba.prange
_prepare()
