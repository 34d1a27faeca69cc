"""Tools for threads: a fair lock for computing, a cache, a worker for the newest request, and executors.

Eight threads that compute in one interpreter are no faster than one thread. They also switch the interpreter lock about
a thousand times a second. On two cores these switches cost as much as the computation (`python -m benchmarks.agent`).
So threads compute in turns and wait in parallel.
"""

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import lru_cache, wraps
from typing import Generic, ParamSpec, TypeVar

STEPS = 8  # a thread that takes more steps than this in one turn must queue again


class ComputingTurn:
    """A fair lock for computing. One thread at a time has the turn, in the order of the requests."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._taken = False
        self._queue: deque[threading.Lock] = deque()  # one lock per waiting thread; its release gives the turn
        self._own = threading.local()

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Wait for all earlier requests, then hold the turn during the block. Not reentrant."""
        self._take()
        try:
            yield
        finally:
            self._give()

    @contextmanager
    def lent(self) -> Iterator[None]:
        """Release the turn during a block that only waits, and queue for the turn again afterwards.

        No effect in a thread that does not hold the turn.
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
        """Count a step of the caller's computation. After more than STEPS steps in one turn, queue for the turn again.

        No effect in a thread that does not hold the turn.
        """
        if getattr(self._own, "has", False):
            self._own.steps += 1
            if self._own.steps > STEPS:
                with self.lent():
                    pass

    def _take(self) -> None:
        with self._guard:
            own_lock = threading.Lock() if self._taken else None
            self._taken = True
            if own_lock is not None:
                own_lock.acquire()
                self._queue.append(own_lock)
        if own_lock is not None:
            own_lock.acquire()
        self._own.has, self._own.steps = True, 0

    def _give(self) -> None:
        self._own.has = False
        with self._guard:
            if self._queue:
                self._queue.popleft().release()
            else:
                self._taken = False


COMPUTING = ComputingTurn()  # the lock that all computing threads of this process share

P = ParamSpec("P")
T = TypeVar("T")


def once(maxsize: int) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that caches the `maxsize` last used values. Thread-safe: one value is computed at a time."""

    def keeping(make: Callable[P, T]) -> Callable[P, T]:
        cached, turn = lru_cache(maxsize)(make), threading.RLock()

        @wraps(make)
        def get(*arguments: P.args, **named: P.kwargs) -> T:
            with turn:
                return cached(*arguments, **named)  # type: ignore[arg-type]  # the arguments must be hashable

        return get

    return keeping


class NewestItemWorker(Generic[T]):
    """A thread that calls `work` for one item at a time. A newer item replaces an item that still waits."""

    def __init__(self, work: Callable[[T], None], name: str) -> None:
        """Start the thread. Exceptions of `work` go to `threading.excepthook`, and the thread continues."""
        self._work = work
        self._waiting: list[T] = []
        self._busy = False
        self._open = True
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def put(self, item: T) -> None:
        """Request work on an item."""
        with self._news:
            self._waiting = [item]
            self._news.notify_all()

    def idle(self, timeout_s: float) -> bool:
        """Wait until all work is done; return whether it was done within `timeout_s`."""
        with self._news:
            return self._news.wait_for(lambda: not self._waiting and not self._busy, timeout_s)

    def close(self) -> None:
        """Wait up to 30 s for the present work, and end the thread. An item that still waits is dropped."""
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
                item, self._waiting, self._busy = self._waiting[0], [], True
            try:
                self._work(item)
            except Exception:
                threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), self._thread)))


class InlineExecutor(Executor):
    """Runs each call at once in the caller's thread. Used in lockstep, where simulated time waits for the call."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class DaemonExecutor(Executor):
    """Runs each call on a daemon thread, so that a model that does not reply cannot keep the process alive."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()

        def call() -> None:
            try:
                future.set_result(fn(*args, **kwargs))
            except BaseException as error:
                future.set_exception(error)

        threading.Thread(target=call, name="model", daemon=True).start()
        return future
