"""Processes that compute and nothing else, beside what is measured."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# it ends by itself soon after whoever started it, however that one ended
BUSY = """
import os, sys
parent = int(sys.argv[1])
while os.getppid() == parent:
    for _ in range(1_000_000):
        pass
"""


@contextmanager
def busy(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Have so many processes compute for the block, each as much as the host gives it.

    Each is a session of its own: where Linux shares the processor out by sessions (sched(7), autogroup), all of them
    together would otherwise weigh no more than one.
    """
    command = [sys.executable, "-c", BUSY, str(os.getpid())]
    started = [subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True) for _ in range(count)]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()
