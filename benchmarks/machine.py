"""What a speed is laid beside so that machines can be compared: the processor time of a loop that does nothing.

`python_loop_ms` is the processor time of a million turns of an empty Python loop, and it is measured before and after
what is timed, since a machine has moods. Two figures follow from it, which a machine three times slower prints alike:

    rtf × loop   how many milliseconds of flight pass in the time of one such loop; more is faster
    ms ÷ loop    how many such loops a frame lasts; less is faster
"""

import os
import platform
import statistics
import time
from typing import Any

import psutil

TURNS = 1_000_000
SAMPLES = 5  # at a time


class Machine:
    """The machine of a run of a benchmark. `look` before and after what is timed."""

    def __init__(self) -> None:
        self._loops_ms: list[float] = []
        self.look()

    def look(self) -> None:
        """Time the loop, some more times."""
        self._loops_ms += [python_loop_ms() for _ in range(SAMPLES)]

    @property
    def loop_ms(self) -> float:
        """The median of all loops so far, ms of processor time."""
        return statistics.median(self._loops_ms)

    def rtf_x_loop(self, rtf_cpu: float) -> float:
        """Return the milliseconds of flight in the time of one loop, of vehicle seconds per processor second."""
        return round(rtf_cpu * self.loop_ms)

    def per_loop(self, cpu_ms: float) -> float:
        """Return how many loops a piece of work lasts, of its milliseconds of processor time."""
        return round(cpu_ms / self.loop_ms, 2)

    def figures(self) -> dict[str, Any]:
        """Return python_loop_ms and what else one wants to know of a machine."""
        return {
            "python_loop_ms": round(self.loop_ms, 1),
            "cpus": os.cpu_count(),
            "load_1min": round(psutil.getloadavg()[0], 2),
            "python": platform.python_version(),
        }


def python_loop_ms() -> float:
    """Return the processor milliseconds of a million turns of an empty loop."""
    began = time.process_time()
    for _ in range(TURNS):
        pass
    return 1e3 * (time.process_time() - began)
