"""The protocol of the engines that fly a campaign (`bench` or `study`), and the engine for one machine."""

import contextlib
import math
import time
from collections import deque
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
from foundation.files import file_errors_as
from foundation.machine import cores
from foundation.run_folder import layout
from foundation.run_folder.reading import result_of
from foundation.run_folder.results import SCORED, Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """One flight to be flown, and the folder for its files."""

    flight: FlightSpec  # `flight.record` is the episode's record
    folder: Path  # folder of the episode; it exists and has only empty logs


class Engine(Protocol):
    """Flies the flights of a campaign. The campaign limits the number of flights at a time."""

    def begin(self, sortie: Sortie) -> None:
        """Begin a flight, without waiting for any flight. Raises DronecatsError when no flight is possible any more."""
        ...

    def landed(self) -> tuple[Sortie, Result]:
        """Wait until a flight ends, and return it with its result. The flight that ends first is returned first.

        The outcome is `error` if the infrastructure failed. If a worker dies or hangs, only its flights in the air are
        lost. Raises DronecatsError when no flight is possible any more, and lets KeyboardInterrupt through.
        """
        ...

    def close(self) -> None:
        """Abort the flights in the air, and leave no process behind."""
        ...


WORKER = ChildKind("worker", "dronecats.bench.worker:Worker", WorkerConfig, needs_keys=True)
POLL_S = 0.2  # wall s, longest wait in one round; in a round, the engine asks each worker once for an ended flight
ANSWER_S = 120.0  # wall s, time limit for a worker's answer to a command; usually it takes less than 1 s
# wall s; a flight hangs if none of its files has grown for so long. The longest regular pause is 300 s, the time limit
# of a question with all its retries.
HANG_S = 900.0
# Files that show the progress of a flight. The record (EPISODE) is written before the map is loaded. So a flight
# counts as begun even if its map never loads.
PROGRESS_FILES = (
    layout.EPISODE, layout.DECISIONS, layout.TRUTH, layout.TLOG, layout.COMMANDER, layout.PROMPTS
)  # fmt: skip


@dataclass(slots=True)
class InFlight:
    """A flight of a worker, and the time of its last written byte."""

    sortie: Sortie
    written: int = -1  # `written_bytes` at the last check; -1: not checked
    since_s: float = field(default_factory=time.monotonic)  # wall time of the last check that changed `written`

    def check(self, written: int) -> None:
        """Store the number of bytes that a check found."""
        if written != self.written:
            self.written, self.since_s = written, time.monotonic()

    @property
    def silent_s(self) -> float:
        """Wall seconds since a check last found a changed file of the flight."""
        return time.monotonic() - self.since_s


@dataclass(slots=True, eq=False)
class _Crew:
    """A worker process, and its flights."""

    process: ChildProcess | None = None  # None: not started, or dead
    is_ready: bool = False
    maps: set[str] = field(default_factory=set)  # maps of its flights so far
    fresh: list[Sortie] = field(default_factory=list)  # flights that have not begun
    flying: dict[str, InFlight] = field(default_factory=dict)  # by folder

    @property
    def load(self) -> int:
        return len(self.fresh) + len(self.flying)


class LocalEngine:
    """Flies in worker processes, at most one per core, each with several flights in the air.

    A worker loads each map once, which takes seconds and 200 MB. So flights on one map go to one worker, unless that
    worker would get more than its share of the flights. A failed flight raises no exception; its result has the error.
    """

    def __init__(self, log: Path, jobs: int, *, workers: int | None = None) -> None:
        """`log`: file for the workers' output; `jobs`: flights at a time, not more than the campaign has.

        `workers`: largest number of workers; None: one per core.
        """
        self._log, self._answer_s, self._hang_s = log, ANSWER_S, HANG_S
        self._most = max(1, min(jobs, workers or cores()))
        self._room = math.ceil(jobs / self._most)  # flights per worker when all are equally busy
        self._config = WorkerConfig(poll_s=POLL_S / self._most)
        self._crews: list[_Crew] = []
        self._landed: deque[tuple[Sortie, Result]] = deque()

    def begin(self, sortie: Sortie) -> None:
        """Hand the flight to a worker. The flight begins when `landed` is called.

        Raises InfrastructureError when no worker can be started.
        """
        crew = self._crew_for(str((sortie.flight.record or {}).get("map")))
        if crew.process is None:
            try:
                crew.process, crew.is_ready = ChildProcess(WORKER, self._config, self._log), False
            except OSError as error:
                raise InfrastructureError(f"no worker can be started: {error}") from None
        crew.fresh.append(sortie)

    def landed(self) -> tuple[Sortie, Result]:
        """Wait until a flight ends, and return it with its result.

        Raises DronecatsError when no worker can be started, or a folder cannot be written.
        """
        with file_errors_as(InfrastructureError, "the run folder cannot be written"):
            while not self._landed:
                try:
                    self._advance()
                except (DronecatsError, OSError):
                    if not self._landed:  # else return a flight; the next call meets the error again
                        raise
        return self._landed.popleft()

    def close(self) -> None:
        """Stop all workers, and abort their flights."""
        for crew in self._crews:
            self._end(crew)

    def _crew_for(self, map_name: str) -> _Crew:
        """Return a worker with this map and with room, else an idle one, else a new one, else the least busy one."""
        loaded = [crew for crew in self._crews if map_name in crew.maps and crew.load < self._room]
        if not loaded and len(self._crews) < self._most and all(crew.load for crew in self._crews):
            self._crews.append(_Crew())
        chosen = min(loaded or self._crews, key=lambda crew: crew.load)
        chosen.maps.add(map_name)
        return chosen

    def _advance(self) -> None:
        """Begin the new flights of every worker, and collect those that have ended. A dead worker loses its flights."""
        for crew in self._crews:
            if crew.process is None or not (crew.fresh or crew.flying):
                continue
            if not crew.is_ready:
                crew.process.ready()  # workers start at the same time; a worker that is started again delays the others
                crew.is_ready = True
            fresh, crew.fresh = crew.fresh, []
            crew.flying |= {str(sortie.folder): InFlight(sortie) for sortie in fresh}
            try:
                self._turn(crew.process, fresh, crew.flying)
            except InfrastructureError as death:
                self._end(crew)
                for flight in crew.flying.values():
                    self._landed.append((flight.sortie, lost_result(flight.sortie, str(death))))
                crew.flying.clear()

    def _turn(self, worker: ChildProcess, fresh: list[Sortie], flying: dict[str, InFlight]) -> None:
        """Begin the flights in `fresh`, and ask once for a flight that has ended.

        Raises InfrastructureError when the worker is gone or hangs.
        """
        for sortie in fresh:
            worker.do("fly", self._answer_s, flight=as_json(sortie.flight), folder=str(sortie.folder))
        outcome = worker.do("ended", self._answer_s)
        if outcome is not None:
            sortie = flying[outcome["folder"]].sortie
            self._landed.append((sortie, flown_result(outcome, sortie)))
            del flying[outcome["folder"]]  # deleted last, so that a full disk does not lose the flight
        for flight in flying.values():
            flight.check(written_bytes(flight.sortie.folder))
        if (found := hanging(list(flying.values()), self._hang_s)) is not None:
            raise InfrastructureError(
                f"the flight in {found.sortie.folder} hangs: its logs have not grown for {self._hang_s:g} s"
            )

    @staticmethod
    def _end(crew: _Crew) -> None:
        if crew.process is not None:
            crew.process.kill()
            crew.process.close()
            crew.process = None


def flown_result(outcome: dict[str, Any], sortie: Sortie) -> Result:
    """Return the result in an outcome of `worker.fly_flight`."""
    fault = outcome.get("fault")
    return result_of(outcome["result"]) if fault is None else lost_result(sortie, fault)


def lost_result(sortie: Sortie, fault: str) -> Result:
    """Return the result of a flight that failed, or whose worker failed.

    The flight is not scored, even if its logs are complete. When the campaign resumes, it is flown again.
    """
    verdict = write_verdict(sortie.folder)
    if verdict.outcome in SCORED:
        (sortie.folder / layout.VERDICT).unlink()
    return Result(episode=sortie.folder.name, outcome="error", success=False, steps=verdict.steps, error=fault)


def hanging(flying: Sequence[InFlight], hang_s: float) -> InFlight | None:
    """Return one flight that hangs among the flights of a worker; None: no flight hangs.

    A flight that has not begun may wait for the others, so it hangs only if all flights of the worker are silent.
    """
    silent = [flight for flight in flying if flight.silent_s > hang_s]
    begun = next((flight for flight in silent if flight.written > 0), None)
    return begun or (silent[0] if silent and len(silent) == len(flying) else None)


def written_bytes(folder: Path) -> int:
    """Return the bytes in the PROGRESS_FILES of a flight."""
    written = 0
    for name in PROGRESS_FILES:
        with contextlib.suppress(OSError):  # not written yet
            written += (folder / name).stat().st_size
    return written
