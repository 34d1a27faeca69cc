"""Flies a list of episodes on several workers, and survives the death of any of them."""

import queue
import threading
from collections.abc import Callable, Sequence

from dronecats.campaign.batch import Batch
from dronecats.campaign.config import WorkerConfig
from dronecats.flight.spec import FlightSpec
from dronecats.judge.episode import write_verdict
from dronecats.processes.supervisor import ChildKind, ChildProcess
from dronecats.rundir.reading import result_of
from dronecats.rundir.results import Result
from foundation.errors import DronecatsError, InfrastructureError

WORKER = ChildKind("worker", "dronecats.campaign.worker", WorkerConfig, asks=True)


class Runner:
    """Hands out episodes, one at a time to each worker, and collects what came of them."""

    def __init__(self, batch: Batch, flight: FlightSpec, jobs: int) -> None:
        """`flight`: each of the run's, but for its episode."""
        self._batch, self._flight, self._jobs = batch, flight, max(1, jobs)
        self._log = batch.run / "worker.log"
        self._workers: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def fly(self, episodes: Sequence[str], on_result: Callable[[Result], None] = lambda result: None) -> list[Result]:
        """Fly the episodes and return their results in the order in which they ended.

        `on_result` is called in the caller's thread as each ends. A worker that dies costs its episode, which comes
        back with the outcome `error`, and is replaced. Raises DronecatsError when no worker can be started, and lets
        KeyboardInterrupt through; either way no process is left behind.
        """
        todo: queue.SimpleQueue[str] = queue.SimpleQueue()
        for episode in episodes:
            todo.put(episode)
        ended: queue.SimpleQueue[Result | DronecatsError | None] = queue.SimpleQueue()
        results: list[Result] = []
        threads: list[threading.Thread] = []
        try:
            first = self._start()  # compiles what has to be; the others find it done
            for k in range(min(self._jobs, len(episodes))):
                threads.append(
                    threading.Thread(target=self._work, args=(todo, ended, first if k == 0 else None), daemon=True)
                )
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

    def _work(
        self,
        todo: "queue.SimpleQueue[str]",
        ended: "queue.SimpleQueue[Result | DronecatsError | None]",
        worker: ChildProcess | None,
    ) -> None:
        """One thread per worker: fly what there is until there is no more."""
        try:
            while not self._stopped:
                try:
                    episode = todo.get_nowait()
                except queue.Empty:
                    break
                worker = worker or self._start()
                try:
                    ended.put(self._one(worker, episode))
                except InfrastructureError as death:
                    self._end(worker)
                    worker = None
                    if not self._stopped:
                        ended.put(self._lost(episode, death))
        except DronecatsError as fault:
            ended.put(fault)
        except OSError as full:
            ended.put(InfrastructureError(f"{self._batch.run} cannot be written: {full.strerror}"))
        finally:
            if worker is not None:
                self._end(worker)
            ended.put(None)

    def _one(self, worker: ChildProcess, episode: str) -> Result:
        folder = self._batch.fresh(episode)
        return result_of(worker.do("fly", None, record=self._batch.record(episode), folder=str(folder)))

    def _lost(self, episode: str, death: InfrastructureError) -> Result:
        """Return the result of an episode whose worker died in flight."""
        folder = self._batch.folder(episode)
        steps = write_verdict(folder).steps
        return Result(episode=folder.name, outcome="error", success=False, steps=steps, error=str(death))

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
