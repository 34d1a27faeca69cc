"""The clock for cameras that are opened without a vehicle."""

import time


def host_us() -> int:
    """Return µs of the machine's monotonic clock."""
    return time.monotonic_ns() // 1000
