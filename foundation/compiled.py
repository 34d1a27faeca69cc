"""`njit` for every kernel of the project, with a cache on disk that no edit can outdate.

numba's own cache notices a change in the file of the outermost function only: after an update of `vehicles/rotor.py`,
a cached `vehicles.multirotor.step` would go on flying the old rotor. So the cache lives in a folder named after the
sources of all kernels.
"""

import contextlib
import hashlib
import os
import shutil
import tempfile
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


def _prepare() -> bool:
    """Point numba at the folder and return whether it can be written to.

    At import, since a decorator reads it when it is applied.
    """
    folder = cache_folder()
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


def njit(*args: Any, **options: Any) -> Any:
    """Return `numba.njit(…)`, cached where that can be; usable with and without arguments.

    Without a folder that can be written to nothing is cached, and each start compiles: numba would keep its work beside
    the sources instead, where an update outdates it, or refuse where they are read-only.
    Without the wrapper by which C code would call a kernel: nobody does, and it takes a tenth of the compile time.
    """
    return numba.njit(*args, **{"cache": KEEPS, "no_cfunc_wrapper": True, **options})


prange = numba.prange
KEEPS = _prepare()  # whether what is compiled is kept for the next start
