"""The clock that a camera is opened with where no vehicle has one."""

import time


def host_us() -> int:
    """Return µs of the machine's monotonic clock."""
    return time.monotonic_ns() // 1000
