"""Flies a list of episodes on several workers, and survives the death of any of them."""

import os
import queue
import threading
from collections.abc import Callable, Sequence
from typing import Any

from dronecats.campaign.batch import Batch
from dronecats.campaign.config import WorkerConfig
from dronecats.flight.spec import FlightSpec
from dronecats.judge.episode import write_verdict
from dronecats.processes.supervisor import ChildKind, ChildProcess
from dronecats.rundir.reading import result_of
from dronecats.rundir.results import Result
from foundation.errors import DronecatsError, InfrastructureError

WORKER = ChildKind("worker", "dronecats.campaign.worker", WorkerConfig, asks=True)
Todo = queue.SimpleQueue[str]
Ended = queue.SimpleQueue[Result | DronecatsError | None]


class Runner:
    """Hands out episodes to workers, a process per core at most, and collects what came of them."""

    def __init__(self, batch: Batch, flight: FlightSpec, jobs: int) -> None:
        """`flight`: each of the run's, but for its episode. `jobs`: how many are in flight at a time."""
        self._batch, self._flight, self._jobs = batch, flight, max(1, jobs)
        self._log = batch.run / "worker.log"
        self._workers: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def fly(self, episodes: Sequence[str], on_result: Callable[[Result], None] = lambda result: None) -> list[Result]:
        """Fly the episodes and return their results in the order in which they ended.

        `on_result` is called in the caller's thread as each ends. A worker that dies costs what it had in flight, which
        comes back with the outcome `error`, and is replaced. Raises DronecatsError when no worker can be started, and
        lets KeyboardInterrupt through; either way no process is left behind.
        """
        todo: Todo = queue.SimpleQueue()
        for episode in episodes:
            todo.put(episode)
        ended: Ended = queue.SimpleQueue()
        results: list[Result] = []
        threads: list[threading.Thread] = []
        try:
            first = self._start()  # compiles what has to be; the others find it done
            for k, flights in enumerate(shares(min(self._jobs, len(episodes)), cores())):
                worker = first if k == 0 else None
                threads.append(threading.Thread(target=self._work, args=(todo, ended, worker, flights), daemon=True))
                threads[-1].start()
            running = len(threads)
            while running:
                result = ended.get()
                if result is None:
                    running -= 1
                elif isinstance(result, DronecatsError):
                    raise result
                else:
                    results.append(result)
                    on_result(result)
        finally:
            self._close()
            for thread in threads:
                thread.join()
        return results

    def _work(self, todo: Todo, ended: Ended, worker: ChildProcess | None, flights: int) -> None:
        """One thread per worker: keep `flights` episodes in flight until there are no more."""
        flying: dict[str, str] = {}  # folder → episode
        try:
            while not self._stopped:
                fresh = _taken(todo, flights - len(flying))
                if not (fresh or flying):
                    break
                worker = worker or self._start()
                try:
                    while fresh:
                        self._begin(worker, fresh.pop(0), flying)
                    told = worker.do("ended", None)
                except InfrastructureError as death:
                    self._end(worker)
                    worker = None
                    if not self._stopped:
                        for episode in flying.values():
                            ended.put(self._lost(episode, str(death)))
                    flying.clear()
                    for episode in fresh:  # never begun
                        todo.put(episode)
                else:
                    ended.put(self._result(flying.pop(told["folder"]), told))
        except DronecatsError as fault:
            ended.put(fault)
        except OSError as full:
            ended.put(InfrastructureError(f"{self._batch.run} cannot be written: {full.strerror}"))
        finally:
            if worker is not None:
                self._end(worker)
            ended.put(None)

    def _begin(self, worker: ChildProcess, episode: str, flying: dict[str, str]) -> None:
        """Have a worker begin an episode, which from now on is among those in flight."""
        folder = str(self._batch.fresh(episode))
        flying[folder] = episode
        worker.do("fly", record=self._batch.record(episode), folder=folder)

    def _result(self, episode: str, told: dict[str, Any]) -> Result:
        return result_of(told["result"]) if "result" in told else self._lost(episode, told["fault"])

    def _lost(self, episode: str, fault: str) -> Result:
        """Return the result of an episode that has none of its own, for what went wrong with it or its worker."""
        folder = self._batch.folder(episode)
        steps = write_verdict(folder).steps
        return Result(episode=folder.name, outcome="error", success=False, steps=steps, error=fault)

    def _start(self) -> ChildProcess:
        try:
            worker = ChildProcess(WORKER, WorkerConfig(flight=self._flight), self._log)
        except OSError as error:
            raise InfrastructureError(f"no worker can be started: {error}") from None
        with self._lock:
            self._workers.add(worker)
            late = self._stopped
        if late:  # `_close` did not see it
            worker.kill()
        worker.ready()
        return worker

    def _end(self, worker: ChildProcess) -> None:
        with self._lock:
            self._workers.discard(worker)
        worker.close()

    def _close(self) -> None:
        """Stop every worker, in the middle of a flight if need be."""
        with self._lock:
            self._stopped = True
            workers, self._workers = list(self._workers), set()
        for worker in workers:
            worker.kill()


def shares(jobs: int, workers: int) -> list[int]:
    """Return how many flights at a time each worker has, of `jobs` in all, as evenly as it goes; none has nothing."""
    workers = min(jobs, workers)
    return [jobs // workers + (k < jobs % workers) for k in range(workers)]


def cores() -> int:
    """Return on how many cores this process may run."""
    return len(os.sched_getaffinity(0))


def _taken(todo: Todo, most: int) -> list[str]:
    """Return the next episodes, at most so many."""
    taken: list[str] = []
    while len(taken) < most:
        try:
            taken.append(todo.get_nowait())
        except queue.Empty:
            break
    return taken
