"""A closed terminal and a polite kill end a flight the way Ctrl-C does: landed, closed, written down."""

import signal
from typing import Any


def as_interrupts() -> None:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt from now on."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
