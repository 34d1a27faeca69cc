"""The clock for cameras that are opened without a vehicle."""

import time


def host_us() -> int:
    """Return the time of the machine's monotonic clock (µs)."""
    return time.monotonic_ns() // 1000
