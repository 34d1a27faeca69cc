"""The engine of one machine: worker processes, one a core at most, each with several flights in the air."""

import os
import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dronecats.bench.engine import Berths, Landed, Sortie
from dronecats.bench.worker import WorkerConfig
from dronecats.flight.processes.supervisor import ChildKind, ChildProcess
from dronecats.flight.spec.spec_file import as_json
from dronecats.judge.episode import write_verdict
from foundation.errors import DronecatsError, InfrastructureError
from foundation.run_folder import layout
from foundation.run_folder.reading import result_of
from foundation.run_folder.results import SCORED, Result

WORKER = ChildKind("worker", "dronecats.bench.worker", WorkerConfig, asks=True)
ANSWER_S = 120.0  # wall s in which a worker says whether a flight is over, which it does within one
# wall s without a new byte in any log of a flight, after which it hangs. The longest pause of a sound one is a question
# that its model is given up for: 300 s, repetitions included. One that has written nothing waits for its first turn
HANG_S = 900.0
LOGS = (layout.DECISIONS, layout.TRUTH, layout.TLOG, layout.COMMANDER)
# what is written of a flight, its record before anything else: one whose map is never finished has begun, too
WRITTEN = (layout.EPISODE, *LOGS)


@dataclass(slots=True)
class _InFlight:
    """A flight of a worker, and since when nothing of it was written."""

    sortie: Sortie
    sizes: tuple[int, ...] = ()
    since_s: float = field(default_factory=time.monotonic)

    def silent_s(self) -> float:
        """Look, and return for how many wall seconds no log of it has grown."""
        sizes, now_s = _sizes(self.sortie.folder, WRITTEN), time.monotonic()
        if sizes != self.sizes:
            self.sizes, self.since_s = sizes, now_s
        return now_s - self.since_s

    @property
    def begun(self) -> bool:
        """Whether anything of it was written when that was looked at last."""
        return any(self.sizes)


class LocalEngine:
    """`jobs` flights at a time. Raises no error for a flight that goes wrong: that is its result."""

    def __init__(
        self, log: Path, jobs: int, *, workers: int | None = None, answer_s: float = ANSWER_S, hang_s: float = HANG_S
    ) -> None:
        """`log`: for what workers say; `jobs`: of what there is to fly; `workers`: at most as many, None: cores."""
        self._log, self._answer_s, self._hang_s = log, answer_s, hang_s
        self._landed: queue.SimpleQueue[Landed | DronecatsError] = queue.SimpleQueue()
        self._inboxes: list[queue.SimpleQueue[Sortie | None]] = []
        self._berths = Berths(jobs, workers or cores())
        self._threads: list[threading.Thread] = []
        self._workers: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def begin(self, sortie: Sortie) -> None:
        """Hand the flight to a worker, as `Berths` has it."""
        record = sortie.flight.record or {}
        chosen = self._berths.take(sortie.folder, str(record.get("map")))
        if chosen == len(self._inboxes):
            self._hire()
        self._inboxes[chosen].put(sortie)

    def landed(self) -> Landed:
        """Wait for the next flight that is over. Raises DronecatsError when no worker can be started."""
        ended = self._landed.get()
        if isinstance(ended, DronecatsError):
            raise ended
        self._berths.leave(ended.sortie.folder)
        return ended

    def close(self) -> None:
        """Stop every worker, in the middle of a flight if need be."""
        with self._lock:
            self._stopped = True
            workers = list(self._workers)
        for worker in workers:
            worker.kill()
        for inbox in self._inboxes:
            inbox.put(None)
        for thread in self._threads:
            thread.join()

    def _hire(self) -> None:
        number = len(self._inboxes)
        self._inboxes.append(queue.SimpleQueue())
        thread = threading.Thread(target=self._work, args=(number,), name=f"worker {number}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _work(self, number: int) -> None:
        """One thread per worker: begin what comes in, and pass on what has landed."""
        inbox = self._inboxes[number]
        flying: dict[str, _InFlight] = {}  # by folder
        worker: ChildProcess | None = None
        try:
            while not self._stopped:
                fresh = _taken(inbox, wait=not flying)
                if worker is None and (fresh or flying):
                    worker = self._start()
                for sortie in fresh:
                    flying[str(sortie.folder)] = _InFlight(sortie)
                try:
                    self._turn(worker, fresh, flying)
                except InfrastructureError as death:
                    self._end(worker)
                    worker = None
                    self._lose(flying, str(death))
        except DronecatsError as fault:
            if not self._stopped:  # else it is one of those that `close` has ended
                self._landed.put(fault)
        except OSError as full:
            self._landed.put(InfrastructureError(f"the run cannot be written: {full.strerror}"))
        except Exception as bug:  # only this thread can report that its flights will never land
            self._landed.put(
                InfrastructureError(f"an unexpected {type(bug).__name__}, which is a mistake in this program: {bug}")
            )
        finally:
            self._end(worker)

    def _turn(self, worker: ChildProcess | None, fresh: list[Sortie], flying: dict[str, _InFlight]) -> None:
        """Begin these, and look once whether one has landed. Raises InfrastructureError: it is gone, or hangs."""
        if worker is None:
            return
        for sortie in fresh:
            worker.do("fly", self._answer_s, flight=as_json(sortie.flight), folder=str(sortie.folder))
        told = worker.do("ended", self._answer_s) if flying else None
        if told is not None:
            sortie = flying.pop(told["folder"]).sortie
            fault = told.get("fault")
            result = lost(sortie, fault) if fault is not None else result_of(told["result"])
            self._landed.put(Landed(sortie=sortie, result=result))
        if (hanging := _hanging(list(flying.values()), self._hang_s)) is not None:
            raise InfrastructureError(
                f"the flight in {hanging.sortie.folder} hangs: no log grew for {self._hang_s:g} s"
            )

    def _lose(self, flying: dict[str, _InFlight], fault: str) -> None:
        """Give up what a worker had in flight."""
        if not self._stopped:
            for each in flying.values():
                self._landed.put(Landed(sortie=each.sortie, result=lost(each.sortie, fault)))
        flying.clear()

    def _start(self) -> ChildProcess:
        try:
            worker = ChildProcess(WORKER, WorkerConfig(), self._log)
        except OSError as error:
            raise InfrastructureError(f"no worker can be started: {error}") from None
        with self._lock:
            self._workers.add(worker)
            late = self._stopped
        if late:  # `close` did not see it
            worker.kill()
        worker.ready()
        return worker

    def _end(self, worker: ChildProcess | None) -> None:
        if worker is not None:
            with self._lock:
                self._workers.discard(worker)
            worker.kill()
            worker.close()


def lost(sortie: Sortie, fault: str) -> Result:
    """Return the result of a flight that has none of its own, for what went wrong with it or its worker.

    It is nobody's score, and flown again by the next run, whatever stands in the logs of what was broken off.
    """
    verdict = write_verdict(sortie.folder)
    if verdict.outcome in SCORED:
        (sortie.folder / layout.VERDICT).unlink()
    return Result(episode=sortie.folder.name, outcome="error", success=False, steps=verdict.steps, error=fault)


def log_sizes(folder: Path) -> tuple[int, ...]:
    """Return the bytes of each log of a flight, 0 where there is none."""
    return _sizes(folder, LOGS)


def cores() -> int:
    """Return on how many cores this process may run."""
    return len(os.sched_getaffinity(0))


def _hanging(flying: Sequence[_InFlight], hang_s: float) -> _InFlight | None:
    """Return a flight of a worker that writes nothing any more, None while there is none.

    Who has not begun waits for others as long as one of them goes on.
    """
    silent = [each for each in flying if each.silent_s() > hang_s]
    begun = next((each for each in silent if each.begun), None)
    return begun or (silent[0] if silent and len(silent) == len(flying) else None)


def _taken(inbox: "queue.SimpleQueue[Sortie | None]", *, wait: bool) -> list[Sortie]:
    """Return all that has come in; with `wait` at least one, but for an end."""
    taken: list[Sortie] = []
    try:
        while True:
            sortie = inbox.get(block=wait and not taken)
            if sortie is None:
                return taken
            taken.append(sortie)
    except queue.Empty:
        return taken


def _sizes(folder: Path, names: Sequence[str]) -> tuple[int, ...]:
    return tuple(_size(folder / name) for name in names)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
