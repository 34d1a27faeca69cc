"""Threads of one process: values made once, turns at computing, and work for the newest request only.

Eight threads of one interpreter that all compute are no faster than one. They take the interpreter from each other some
thousand times a second, and with two cores that alone costs as much again as what they compute
(`python -m benchmarks.agent`). So they compute in turns, in their order, and wait side by side.
"""

import sys
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Generic, ParamSpec, TypeVar

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


P = ParamSpec("P")
T = TypeVar("T")
_expects_more = threading.Event()


def expect_more() -> None:
    """Say that this process flies many episodes: what recurs is kept from the first on."""
    _expects_more.set()


def once(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that keeps the `maxsize` values used last; who asks for one in the making waits for it."""

    def keeping(make: Callable[P, T]) -> Callable[P, T]:
        kept: OrderedDict[object, T] = OrderedDict()
        turn = threading.RLock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T:
            key = (arguments, tuple(named.items()))
            with turn:
                if key not in kept:
                    kept[key] = make(*arguments, **named)
                    if len(kept) > maxsize:
                        kept.popitem(last=False)
                kept.move_to_end(key)
                return kept[key]

        return get

    return keeping


def recurring(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T | None]]:
    """Return a decorator as `once`, whose function returns None to who asks first, and makes what is asked for again.

    For what helps a process that flies many episodes, and would only cost memory in one that flies a single one. After
    `expect_more` nobody is the first.
    """

    def keeping(make: Callable[P, T]) -> Callable[P, T | None]:
        kept = once(maxsize)(make)
        asked: OrderedDict[object, None] = OrderedDict()
        turn = threading.Lock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T | None:
            key = (arguments, tuple(named.items()))
            with turn:
                first = key not in asked and not _expects_more.is_set()
                asked[key] = None
                asked.move_to_end(key)
                if len(asked) > maxsize:
                    asked.popitem(last=False)
            return None if first else kept(*arguments, **named)

        return get

    return keeping


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
