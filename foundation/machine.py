"""This machine: the user's cache folder, its memory, and who holds a local port.

Memory is asked for before compiled code is loaded, which crashes when it gets none. A limit on the address space
(`ulimit -v`, RLIMIT_AS) counts what is reserved, which is several times what is used: each thread reserves a stack and
an arena of the allocator.
"""

import os
import resource
from pathlib import Path

from foundation.errors import UsageError


def user_cache() -> Path:
    """Return the folder: below NUMBA_CACHE_DIR where that is set, else the user's. Raises UsageError without a home."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "dronecats"
    except RuntimeError:  # a user id that has no home
        raise UsageError("this user has no home folder for compiled code, and NUMBA_CACHE_DIR is not set") from None


PER_CORE_GB = 0.08  # reserved by the threads that numerical libraries start, one a core
CORES_MEASURED = 2  # on which `needed_gb` of callers was measured


def limit_gb() -> float | None:
    """Return how much address space this process may have, None where it is not limited."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit / 1e9


def check(what: str, needed_gb: float) -> None:
    """Raise UsageError if the limit on the address space is below what `what` needs.

    `needed_gb`: on `CORES_MEASURED` cores; on a machine with more it is more.
    """
    limit = limit_gb()
    if needed_gb and limit is not None and limit < (needed := on_this_machine(needed_gb)):
        raise UsageError(
            f"{what} needs {needed:.1f} GB of address space, and the limit is {limit:.1f} GB; raise it, for example "
            f"with: ulimit -v {round(1e6 * needed + 1e5)}"
        )


def on_this_machine(needed_gb: float) -> float:
    """Return what is needed here of what was measured on `CORES_MEASURED` cores."""
    return needed_gb + PER_CORE_GB * max(0, (os.cpu_count() or 1) - CORES_MEASURED)


def port_holder(protocol: str, port: int) -> str | None:
    """Return 'name (process id N)' of the program that holds a local port, None when that cannot be known.

    `protocol`: 'UDP' or 'TCP'.
    """
    try:
        import psutil

        for connection in psutil.net_connections(protocol.lower()):
            if connection.laddr and connection.laddr.port == port and connection.pid:
                return f"{psutil.Process(connection.pid).name()} (process id {connection.pid})"
    except Exception:  # psutil is optional, and looking at other people's processes may be refused
        return None
    return None
