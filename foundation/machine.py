"""Facts about this machine: the user's cache folder, host names, cores, limit on address space, programs on ports.

`check` is called before compiled code is loaded, because compiled code crashes when it runs out of memory. The limit on
the address space (`ulimit -v`, RLIMIT_AS) counts reserved memory, which is several times the used memory: each thread
reserves a stack and an arena of the allocator.
"""

import os
import resource
from pathlib import Path

from foundation.errors import UsageError


def user_cache() -> Path:
    """Return folder `dronecats` in NUMBA_CACHE_DIR, XDG_CACHE_HOME or ~/.cache. Raises UsageError without a home."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(base or Path.home() / ".cache") / "dronecats"
    except RuntimeError:  # a user id that has no home
        raise UsageError("this user has no home folder for compiled code. Set NUMBA_CACHE_DIR to a folder") from None


def is_host(name: str) -> bool:
    """Return whether a host name or address has a valid form: no part of it is empty or longer than 63 characters."""
    try:
        return bool(name.encode("idna"))
    except UnicodeError:
        return False


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


PER_CORE_GB = 0.08  # GB of address space per core: numerical libraries start a thread per core
CORES_MEASURED = 2  # cores of the machine on which the values of `needed_gb` were measured


def limit_gb() -> float | None:
    """Return the limit of this process's address space; None without one."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit / 1e9


def check(name: str, needed_gb: float) -> None:
    """Raise UsageError if the limit on the address space is too low for `name`, for example a command.

    `needed_gb`: the need (GB) as measured on `CORES_MEASURED` cores; more cores need more.
    """
    limit = limit_gb()
    if needed_gb and limit is not None and limit < (needed := on_this_machine(needed_gb)):
        raise UsageError(
            f"{name} needs {needed:.1f} GB of address space, but the limit is {limit:.1f} GB. Raise it, for example"
            f" with: ulimit -v {round(1e6 * needed + 1e5)}"
        )


def on_this_machine(needed_gb: float) -> float:
    """Return the address space (GB) that is needed on this machine, if `CORES_MEASURED` cores need `needed_gb`."""
    return needed_gb + PER_CORE_GB * max(0, (os.cpu_count() or 1) - CORES_MEASURED)


def port_holder(protocol: str, port: int) -> str | None:
    """Return 'name (process id N)' of the program that holds a local port; None if unknown.

    `protocol`: 'UDP' or 'TCP'.
    """
    try:
        import psutil

        for connection in psutil.net_connections(protocol.lower()):
            if connection.laddr and connection.laddr.port == port and connection.pid:
                return f"{psutil.Process(connection.pid).name()} (process id {connection.pid})"
    except Exception:  # psutil is optional, and other users' processes may be hidden
        return None
    return None
