"""The protocol of engines, which fly the flights of a campaign, and the engine of one machine."""

import math
import os
import queue
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from dronecats.bench.worker import WorkerConfig
from dronecats.flight.processes.supervisor import ChildKind, ChildProcess
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_json
from dronecats.judge.episode import write_verdict
from foundation.errors import DronecatsError, InfrastructureError
from foundation.run_folder import layout
from foundation.run_folder.reading import result_of
from foundation.run_folder.results import SCORED, Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """One flight, and where its files go."""

    flight: FlightSpec  # with the record of its episode
    folder: Path  # the episode's, prepared: it exists, and holds only empty logs


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed:
    """A flight that is over."""

    sortie: Sortie
    result: Result  # with the outcome `error` when the infrastructure failed


class Engine(Protocol):
    """Flies the flights that a campaign begins. The campaign limits how many are in the air."""

    def begin(self, sortie: Sortie) -> None:
        """Begin a flight. Never waits for one. Raises DronecatsError when nothing can be flown any more."""
        ...

    def landed(self) -> Landed:
        """Wait for the next flight that is over, in the order in which they end.

        A worker that dies or hangs loses only its flights in the air. Raises DronecatsError as `begin`, and lets
        KeyboardInterrupt through.
        """
        ...

    def close(self) -> None:
        """Abort the flights in the air, and leave no process behind."""
        ...


class WorkerSlots:
    """Assigns flights to the workers of one machine, by number.

    A worker loads each map once: seconds, and 200 MB. Flights of one map go to one worker, as far as all workers stay
    equally busy.
    """

    def __init__(self, jobs: int, workers: int) -> None:
        """`jobs`: flights in the air at a time, at most the flights that exist; `workers`: at most so many, from 1."""
        self._most = max(1, min(jobs, workers))
        self._room = math.ceil(jobs / self._most)  # of a worker, when all are equally busy
        self._flights: list[set[Path]] = []
        self._maps: list[set[str]] = []

    def take(self, flight: Path, map_name: str) -> int:
        """Return the worker that flies it: one with room and its map, else an idle or new one, else the least busy."""
        loaded = [
            k for k, maps in enumerate(self._maps) if map_name in maps and len(self._flights[k]) < self._room
        ]  # fmt: skip
        if loaded:
            chosen = min(loaded, key=self._busy)
        elif len(self._flights) < self._most and all(self._flights):
            chosen = len(self._flights)
            self._flights.append(set())
            self._maps.append(set())
        else:
            chosen = min(range(len(self._flights)), key=self._busy)
        self._flights[chosen].add(flight)
        self._maps[chosen].add(map_name)
        return chosen

    def leave(self, flight: Path) -> None:
        """Free the slot of a flight that is over."""
        for flights in self._flights:
            flights.discard(flight)

    def _busy(self, worker: int) -> int:
        return len(self._flights[worker])


WORKER = ChildKind("worker", "dronecats.bench.worker", WorkerConfig, needs_keys=True)
ANSWER_S = 120.0  # wall s for a worker to answer whether a flight is over; it takes less than 1 s
# wall s without a new byte in any log of a flight, after which it hangs. The longest pause of a sound flight is a
# question that is given up: 300 s, retries included. A flight that has written nothing waits for its first turn
HANG_S = 900.0
LOGS = (layout.DECISIONS, layout.TRUTH, layout.TLOG, layout.COMMANDER)
# files of a flight; its record comes first, so that a flight whose map never finishes loading has begun, too
WRITTEN = (layout.EPISODE, *LOGS)


@dataclass(slots=True)
class _InFlight:
    """A flight of a worker, and the time of its last written byte."""

    sortie: Sortie
    sizes: tuple[int, ...] = ()
    since_s: float = field(default_factory=time.monotonic)

    def silent_s(self) -> float:
        """Return for how many wall seconds no log of it has grown."""
        sizes, now_s = _sizes(self.sortie.folder, WRITTEN), time.monotonic()
        if sizes != self.sizes:
            self.sizes, self.since_s = sizes, now_s
        return now_s - self.since_s

    @property
    def begun(self) -> bool:
        """Whether it had written anything when `silent_s` last looked."""
        return any(self.sizes)


class LocalEngine:
    """Flies in worker processes, at most one per core, each with several flights in the air.

    A flight that goes wrong raises nothing: its result has the error.
    """

    def __init__(
        self, log: Path, jobs: int, *, workers: int | None = None, answer_s: float = ANSWER_S, hang_s: float = HANG_S
    ) -> None:
        """`log`: file of the workers' output; `jobs`: flights at a time; `workers`: at most so many, None: cores."""
        self._log, self._answer_s, self._hang_s = log, answer_s, hang_s
        self._landed: queue.SimpleQueue[Landed | DronecatsError] = queue.SimpleQueue()
        self._inboxes: list[queue.SimpleQueue[Sortie | None]] = []
        self._slots = WorkerSlots(jobs, workers or cores())
        self._threads: list[threading.Thread] = []
        self._workers: set[ChildProcess] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def begin(self, sortie: Sortie) -> None:
        """Hand the flight to the worker that `WorkerSlots` chooses."""
        record = sortie.flight.record or {}
        chosen = self._slots.take(sortie.folder, str(record.get("map")))
        if chosen == len(self._inboxes):
            self._hire()
        self._inboxes[chosen].put(sortie)

    def landed(self) -> Landed:
        """Wait for the next flight that is over. Raises DronecatsError when no worker can be started."""
        ended = self._landed.get()
        if isinstance(ended, DronecatsError):
            raise ended
        self._slots.leave(ended.sortie.folder)
        return ended

    def close(self) -> None:
        """Stop every worker, and abort its flights."""
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
        """Begin flights from the inbox and pass on those that landed. One thread per worker."""
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
            if not self._stopped:  # else `close` ended the worker
                self._landed.put(fault)
        except OSError as full:
            self._landed.put(InfrastructureError(f"the run folder cannot be written: {full.strerror}"))
        except Exception as bug:  # only this thread can report that its flights will never land
            self._landed.put(
                InfrastructureError(f"an unexpected {type(bug).__name__}, which is a bug in dronecats: {bug}")
            )
        finally:
            self._end(worker)

    def _turn(self, worker: ChildProcess | None, fresh: list[Sortie], flying: dict[str, _InFlight]) -> None:
        """Begin fresh flights, and check once for a landed one.

        Raises InfrastructureError when the worker is gone or hangs.
        """
        if worker is None:
            return
        for sortie in fresh:
            worker.do("fly", self._answer_s, flight=as_json(sortie.flight), folder=str(sortie.folder))
        outcome = worker.do("ended", self._answer_s) if flying else None
        if outcome is not None:
            sortie = flying.pop(outcome["folder"]).sortie
            self._landed.put(landed_with(outcome, sortie))
        if (hanging := _hanging(list(flying.values()), self._hang_s)) is not None:
            raise InfrastructureError(
                f"the flight in {hanging.sortie.folder} hangs: its logs have not grown for {self._hang_s:g} s"
            )

    def _lose(self, flying: dict[str, _InFlight], fault: str) -> None:
        """Give up the flights of a dead worker."""
        if not self._stopped:
            for flight in flying.values():
                self._landed.put(lost(flight.sortie, fault))
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


def landed_with(outcome: dict[str, Any], sortie: Sortie) -> Landed:
    """Return a flight that is over, from what `worker.fly_flight` returned."""
    fault = outcome.get("fault")
    return lost(sortie, fault) if fault is not None else Landed(sortie=sortie, result=result_of(outcome["result"]))


def lost(sortie: Sortie, fault: str) -> Landed:
    """Return a flight that has no result, because of a fault of it or of its worker.

    It is not scored, even if its logs are complete. The next run flies it again.
    """
    verdict = write_verdict(sortie.folder)
    if verdict.outcome in SCORED:
        (sortie.folder / layout.VERDICT).unlink()
    result = Result(episode=sortie.folder.name, outcome="error", success=False, steps=verdict.steps, error=fault)
    return Landed(sortie=sortie, result=result)


def log_sizes(folder: Path) -> tuple[int, ...]:
    """Return the size in bytes of each log of a flight, 0 for a missing one."""
    return _sizes(folder, LOGS)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def _hanging(flying: Sequence[_InFlight], hang_s: float) -> _InFlight | None:
    """Return a flight of a worker that has stopped writing, None while there is none.

    A flight that has not begun may wait as long as another one writes.
    """
    silent = [flight for flight in flying if flight.silent_s() > hang_s]
    begun = next((flight for flight in silent if flight.begun), None)
    return begun or (silent[0] if silent and len(silent) == len(flying) else None)


def _taken(inbox: "queue.SimpleQueue[Sortie | None]", *, wait: bool) -> list[Sortie]:
    """Return all sorties in the inbox; with `wait` at least one, unless the inbox ends."""
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
