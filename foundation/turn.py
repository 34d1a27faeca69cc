"""Threads that compute one after another and wait side by side.

Eight threads of one interpreter that all compute do so no faster than one: they only take the interpreter from each
other, some thousand times a second, and with two cores that alone costs as much again as what they compute
(`python -m benchmarks.agent`). And of equal tasks in their order the half is done when half the time has passed, of
tasks that all go on at once none.
"""

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

STEPS = 8  # in one turn; who waits for something outside in every step never takes so many


class ComputingTurn:
    """Which of the threads that ask for it computes: one at a time, in the order in which they have asked."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._taken = False
        self._queue: deque[threading.Lock] = deque()  # each locked, and released for its owner
        self._own = threading.local()

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Have the turn for the block, as soon as all who asked before have had theirs. Not twice in one thread."""
        self._take()
        try:
            yield
        finally:
            self._give()

    @contextmanager
    def lent(self) -> Iterator[None]:
        """Let others have it during the block, which only waits, and then stand in the queue for it again.

        A thread that does not have it may do so too, and nothing comes of it.
        """
        if not getattr(self._own, "has", False):
            yield
            return
        self._give()
        try:
            yield
        finally:
            self._take()

    def step(self) -> None:
        """Say that a step of many begins: after some in one turn the others have theirs, so that nobody waits long.

        Of a thread that does not have the turn nothing comes of it.
        """
        if getattr(self._own, "has", False):
            self._own.steps += 1
            if self._own.steps > STEPS:
                with self.lent():
                    pass

    def _take(self) -> None:
        with self._guard:
            mine = threading.Lock() if self._taken else None
            self._taken = True
            if mine is not None:
                mine.acquire()
                self._queue.append(mine)
        if mine is not None:
            mine.acquire()
        self._own.has, self._own.steps = True, 0

    def _give(self) -> None:
        self._own.has = False
        with self._guard:
            if self._queue:
                self._queue.popleft().release()
            else:
                self._taken = False


COMPUTING = ComputingTurn()  # of this process
