"""Where a user's machine keeps what can be made again: compiled kernels, parsed sources."""

import os
from pathlib import Path

from foundation.errors import UsageError


def user_cache() -> Path:
    """Return the folder: below NUMBA_CACHE_DIR where that is set, else the user's. Raises UsageError without a home."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "dronecats"
    except RuntimeError:  # a user id that has no home
        raise UsageError("this user has no home folder for compiled code, and NUMBA_CACHE_DIR is not set") from None
