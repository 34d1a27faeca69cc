"""Measures the machine's speed and processor times, and prints a benchmark's figures.

`python_loop_ms` is the processor time of one loop: a million turns of an empty `for` in Python. It is measured before
and after the benchmark, because the speed of a machine varies. Two kinds of figures are relative to this time. They
would be the same on a machine that is three times slower:

    …_rtf_x_loop   milliseconds of flight in the time of one loop; more is faster
    …_per_loop     processor time in loops; less is faster
"""

import argparse
import json
import os
import platform
import statistics
import time
from typing import Any

import psutil

TURNS = 1_000_000
SAMPLES = 5  # loops per `look`


class Machine:
    """The machine of a benchmark. Create it before the timed part, and call `look` after it."""

    def __init__(self) -> None:
        self._loops_ms: list[float] = []
        self.look()

    def look(self) -> None:
        """Time the loop SAMPLES more times."""
        self._loops_ms += [python_loop_ms() for _ in range(SAMPLES)]

    @property
    def loop_ms(self) -> float:
        """The median of all loops so far, ms of processor time."""
        return statistics.median(self._loops_ms)

    def rtf_x_loop(self, rtf_cpu: float) -> float:
        """Return the ms of flight in the time of one loop. `rtf_cpu`: vehicle seconds per processor second."""
        return round(rtf_cpu * self.loop_ms)

    def per_loop(self, cpu_ms: float) -> float:
        """Return the number of loops that take as long as `cpu_ms` of processor time."""
        return round(cpu_ms / self.loop_ms, 2)

    def figures(self) -> dict[str, Any]:
        """Return python_loop_ms, the number of processors, the load and the version of Python."""
        return {
            "python_loop_ms": round(self.loop_ms, 1),
            "cpus": os.cpu_count(),
            "load_1min": round(psutil.getloadavg()[0], 2),
            "python": platform.python_version(),
        }


def python_loop_ms() -> float:
    """Return the processor milliseconds of one loop."""
    began = time.process_time()
    for _ in range(TURNS):
        pass
    return 1e3 * (time.process_time() - began)


def children_cpu_s() -> float:
    """Return the processor seconds of all child processes that have ended, and of their children."""
    times = os.times()
    return times.children_user + times.children_system


def total_cpu_s() -> float:
    """Return the processor seconds of this process and of all child processes that have ended."""
    times = os.times()
    return times.user + times.system + children_cpu_s()


def process_cpu_s(pid: int) -> float:
    """Return the processor seconds that a running process has used."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def benchmark_parser(description: str | None, *, short: str) -> argparse.ArgumentParser:
    """Return a parser with the options of every benchmark; `short` is the help of --short."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--short", action="store_true", help=short)
    return parser


def print_figures(figures: dict[str, Any], as_json: bool) -> None:
    """Print the figures as one JSON object, or each figure on a line."""
    if as_json:
        print(json.dumps(figures))
        return
    for name, value in figures.items():
        print(f"{name:34} {value}")
