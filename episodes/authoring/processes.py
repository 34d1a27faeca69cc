"""Distributes work on many items among processes. The processes end when their parent ends."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from foundation.errors import InfrastructureError

Item = TypeVar("Item")
Result = TypeVar("Result")


def process_map(work: Callable[[Item], Result], items: Sequence[Item], jobs: int | None = None) -> Iterator[Result]:
    """Yield the result of each item in the order in which `jobs` processes (default: one per core) finish them.

    Call it in the main thread, because it sets signal handlers. With only one job or item, this process does the work.
    A terminal sends Ctrl-C to all processes, but the new processes ignore it. They end when this process ends or is
    killed. Raises the exceptions of `work`, and InfrastructureError if a process dies.
    """
    jobs = min(jobs or os.cpu_count() or 1, len(items))
    if jobs <= 1:
        yield from map(work, items)
        return
    before_us, complete = set(multiprocessing.active_children()), False
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _end_with_the_parent) as pool:
        interrupts = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # delay Ctrl-C until SIG_SETMASK below
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # the processes that `submit` starts inherit this
        try:
            futures = [pool.submit(work, item) for item in items]
        finally:
            signal.signal(signal.SIGINT, before)
        try:
            signal.pthread_sigmask(signal.SIG_SETMASK, interrupts)
            for done in as_completed(futures):
                yield done.result()
            complete = True
        except BrokenProcessPool:
            raise InfrastructureError(
                "a process ended unexpectedly, perhaps for lack of memory. Use fewer --jobs."
            ) from None
        finally:
            if not complete:  # the pending results are not needed
                for process in set(multiprocessing.active_children()) - before_us:
                    process.kill()


def _end_with_the_parent() -> None:
    threading.Thread(target=_wait_and_end, daemon=True).start()


def _wait_and_end() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
