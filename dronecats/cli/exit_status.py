"""Computes the exit status of a program, and makes signals end the program like Ctrl-C."""

import signal
import sys
from collections.abc import Callable
from typing import Any

from foundation.errors import DronecatsError, UsageError
from foundation.extras import missing_package

INTERRUPTED = 130


def exit_status(program: str, work: Callable[[], int]) -> int:
    """Call `work` and return its status. Errors give 2 (usage or missing package), 3 (failure) or 130 (interrupted).

    An error is printed as one sentence on standard error.
    """
    try:
        return work()
    except DronecatsError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return error.exit_status
    except ImportError as error:
        sentence = missing_package(error)
        if sentence is None:  # a bug: show the traceback
            raise
        print(f"{program}: {sentence}", file=sys.stderr)
        return UsageError.exit_status
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return INTERRUPTED
    finally:
        # A Ctrl-C during an `exec` of text, as in dataclasses and Numba, sets a flag in Python. The flag stays set if
        # the KeyboardInterrupt is caught. Python then ends by a signal, not a status. Another `exec` clears the flag.
        exec("")


def interrupt_on_signals() -> None:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt, so that a flight lands, closes and keeps its files.

    A signal that is already ignored stays ignored, such as SIGHUP after `nohup`.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
