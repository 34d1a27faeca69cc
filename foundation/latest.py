"""Work that is done for the newest request only: while something is dragged, older places are of no interest."""

import sys
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """One thread that calls `work` with the newest thing it was given, never twice at a time."""

    def __init__(self, work: Callable[[T], None], name: str) -> None:
        """Start the thread. What `work` raises goes to the threading module's hook and ends nothing."""
        self._work = work
        self._waiting: list[T] = []
        self._busy = False
        self._open = True
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, thing: T) -> None:
        """Ask for work on a thing; one that still waits is forgotten."""
        with self._news:
            self._waiting = [thing]
            self._news.notify_all()

    def idle(self, timeout_s: float) -> bool:
        """Wait until everything asked for is done; return whether that came to pass within the time."""
        with self._news:
            return self._news.wait_for(lambda: not self._waiting and not self._busy, timeout_s)

    def close(self) -> None:
        """End the thread once its present work is done."""
        with self._news:
            self._open = False
            self._news.notify_all()
        self._thread.join(timeout=30.0)

    def _run(self) -> None:
        while True:
            with self._news:
                self._busy = False
                self._news.notify_all()
                self._news.wait_for(lambda: self._waiting or not self._open)
                if not self._open:
                    return
                thing, self._waiting, self._busy = self._waiting[0], [], True
            try:
                self._work(thing)
            except Exception:
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), self._thread)))
