"""Runs another program, and ends its process group when standard input ends.

    python -m dronecats.flight.processes.guard COMMAND [ARGUMENT …]

Standard input is a pipe from the parent. It closes when the parent ends, even by a kill -9. The program's own standard
input stays open and empty, because PX4's shell would read a closed input in a busy loop. The guard exits with the
program's exit status.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time

PATIENCE_S = 3.0  # wall seconds between SIGTERM and SIGKILL


def main() -> int:
    program = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, start_new_session=True)

    def let_go() -> None:
        os.read(0, 1)
        end(program)

    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, lambda *_: end(program))
    threading.Thread(target=let_go, daemon=True).start()
    status = program.wait()
    end(program)  # also ends background processes that a wrapper script leaves behind
    return status if status >= 0 else 128 - status


def end(program: "subprocess.Popen[bytes]") -> None:
    """End the program and all its children: first SIGTERM, then SIGKILL."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(program.pid, signal.SIGTERM)
        due_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < due_s:
            program.poll()
            os.killpg(program.pid, 0)
            time.sleep(0.05)
        os.killpg(program.pid, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main())
