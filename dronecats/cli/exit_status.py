"""Ends a program: its exit status, and signals that end it like Ctrl-C."""

import signal
import sys
from collections.abc import Callable
from typing import Any

from foundation.errors import DronecatsError, UsageError
from foundation.extras import missing_package

INTERRUPTED = 130


def exit_status(program: str, work: Callable[[], int]) -> int:
    """Return the status that `work` returns; 2 wrong usage or a missing package, 3 something broke, 130 interrupted.

    An error is printed as one sentence on standard error.
    """
    try:
        return work()
    except DronecatsError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return error.exit_status
    except ImportError as error:
        sentence = missing_package(error)
        if sentence is None:  # a bug, which the traceback explains best
            raise
        print(f"{program}: {sentence}", file=sys.stderr)
        return UsageError.exit_status
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED
    finally:
        # A Ctrl-C inside an `exec` of text (dataclasses and Numba make functions so) marks the whole process as killed
        # by it even if it is caught, and Python then kills itself instead of returning a status. Each `exec` clears it.
        exec("")


def interrupt_on_signals() -> None:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt from now on: a flight lands, closes and keeps its files."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
