"""A campaign: flies the episodes of many runs in order, retries flights that did not move, and stops at the cost limit.

All state is in the run folders. Each change of state is one rename, or one file that is either complete or missing. So
a process that is killed at any moment loses only its flights in the air.
"""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from dronecats.bench.engine import Engine, LocalEngine, Sortie
from dronecats.bench.matrix import BenchEntry
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.judge.metrics.failure_mode import is_stuck, poses_of, track_m
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from foundation.errors import InfrastructureError, UsageError
from foundation.files import file_errors_as, write_json
from foundation.run_folder import layout
from foundation.run_folder.folder import LOCK, differences, hold, prepare, write_run
from foundation.run_folder.reading import json_object
from foundation.run_folder.results import SCORED, Result


class Batch:
    """A run folder. It has a folder for each episode, and the episode's id is the folder's name.

    An episode is done when its folder has a verdict of success or failure, and its record has not changed since.
    """

    def __init__(self, run: Path, configuration: Mapping[str, Any]) -> None:
        """Create the folder, or resume an existing one.

        Raises UsageError when the folder is not a run, has another configuration or cannot be written.
        """
        self.run = run
        self._records: dict[str, EpisodeRecord] = {}
        with file_errors_as(UsageError, f"the run folder {run} cannot be written"):
            run.mkdir(parents=True, exist_ok=True)
            self._lock = hold(run / LOCK, run)
            before = json_object(run / layout.RUN)
            if before is not None:
                changed = differences(before, configuration)
                if changed:
                    raise UsageError(
                        f"{run} is a run with another {', '.join(changed)}. Choose another --out, or use"
                        " the same options"
                    )
            elif any(path.name != LOCK for path in run.iterdir()):
                raise UsageError(f"{run} is not empty and has no run.json, so it is not a run. Choose another --out")
            write_run(run, dict(configuration))

    def close(self) -> None:
        """Release the run for another process."""
        self._lock.close()

    def folder(self, episode: str) -> Path:
        """Return the folder of an episode. Raises UsageError when its record cannot be read."""
        return self.run / self._record(episode).id

    def record(self, episode: str) -> dict[str, Any]:
        """Return an episode's record as JSON values. Raises UsageError when it cannot be read."""
        return dict(json.loads(self._record(episode).to_json()))

    def done(self, episode: str) -> dict[str, Any] | None:
        """Return the verdict of an episode; None: it is not done."""
        folder = self.folder(episode)
        if json_object(folder / layout.EPISODE) != self.record(episode):
            return None
        verdict = json_object(folder / layout.VERDICT)
        return verdict if verdict is not None and verdict.get("outcome") in SCORED else None

    def left(self, episodes: Iterable[str], *, retry: bool = False) -> list[str]:
        """Return the episodes that remain to be flown, in their order; `retry`: also the `stuck` ones."""
        return [episode for episode in episodes if self.done(episode) is None or (retry and self.stuck(episode))]

    def stuck(self, episode: str) -> bool:
        """Return whether an episode failed, its drones did not move, and it was not retried yet."""
        folder, verdict = self.folder(episode), self.done(episode)
        if verdict is None or verdict["outcome"] == "success" or self.retried(episode):
            return False
        try:
            return is_stuck(poses_of(folder))
        except UsageError:  # a log is damaged; the verdict reports it
            return False

    def retried(self, episode: str) -> bool:
        """Return whether an episode, with its current record, was retried because its drones did not move."""
        name, record = self.folder(episode).name, self.record(episode)
        before = [self.run / layout.RETRIED / name, *(self.run / layout.RETRIED).glob(f"{name}-[0-9]*")]
        return any(json_object(folder / layout.EPISODE) == record for folder in before)

    def fresh(self, episode: str) -> Path:
        """Return an empty folder for an episode.

        The folder of an earlier attempt is moved to `unfinished`, or to `retried` if its drones did not move. Raises
        OSError.
        """
        folder = self.folder(episode)
        if folder.exists():
            kept = self.run / (layout.RETRIED if self.stuck(episode) else layout.UNFINISHED)
            kept.mkdir(exist_ok=True)
            folder.rename(_free(kept, folder.name, bare=kept.name == layout.RETRIED))
        prepare(folder)
        if (self.run / layout.RETRIED).is_dir():
            write_json(self.run / layout.RETRIES, self._retries())
        return folder

    def _retries(self) -> dict[str, Any]:
        """Return the contents of retries.json: outcome and track length (m) of each flight that was retried."""
        return {
            before.name: {
                "outcome": (json_object(before / layout.VERDICT) or {}).get("outcome"),
                "track_m": round(track_m(poses_of(before)) or 0.0, 3),
            }
            for before in sorted((self.run / layout.RETRIED).iterdir())
        }

    def _record(self, episode: str) -> EpisodeRecord:
        if episode not in self._records:
            self._records[episode] = catalogue.load(episode)
        return self._records[episode]


def _free(folder: Path, name: str, *, bare: bool) -> Path:
    """Return an unused path in `folder`: `name` if it is unused and `bare`, else `name` with the next number."""
    if bare and not (folder / name).exists():
        return folder / name
    number = 1
    while (folder / f"{name}-{number}").exists():
        number += 1
    return folder / f"{name}-{number}"


Ending = Literal["flown", "budget"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRun:
    """A run with its locked folder."""

    entry: BenchEntry
    batch: Batch
    part: tuple[str, ...]  # ids or files of the episodes that this process flies


@dataclass(frozen=True, slots=True, kw_only=True)
class EndedFlight:
    """A flight that has ended."""

    run: OpenRun
    result: Result
    again: bool  # the drones did not move and the flight is retried, so this is not the final result
    dropped: int = 0  # number of flights with the same models that are cancelled, because an endpoint rejects questions


class Campaign:
    """The remaining flights of some runs. All state is in the run folders."""

    def __init__(self, runs: Sequence[OpenRun], *, jobs: int, retry: bool = True) -> None:
        """`jobs`: flights in the air at a time. `retry`: retry flights that did not move."""
        self._jobs, self._retry = max(1, jobs), retry
        self._todo = deque(_in_order(runs, retry))

    @property
    def left(self) -> frozenset[tuple[str, str]]:
        """The flights that remain, including those to be retried, as (name of the run, episode)."""
        return frozenset((run.entry.name, episode) for run, episode in self._todo)

    def fly(self, engine: Engine, on_end: Callable[[EndedFlight], None] = lambda flight: None) -> Ending:
        """Fly the remaining flights. Return "flown", or "budget" if the cost limit was reached. Closes the engine.

        `on_end` is called in the caller's thread after each flight. An error of one flight is in its result. Raises
        DronecatsError when no flight is possible any more, and lets KeyboardInterrupt through.
        """
        flying: dict[Path, tuple[OpenRun, str]] = {}
        ending: Ending = "flown"
        try:
            while self._todo or flying:
                while self._todo and len(flying) < self._jobs:
                    run, episode = self._todo.popleft()
                    sortie = self._sortie(run, episode)
                    flying[sortie.folder] = run, episode
                    engine.begin(sortie)
                sortie, result = engine.landed()
                run, episode = flying.pop(sortie.folder)
                if result.reason == "budget":
                    ending = "budget"
                    self._todo.clear()
                dropped = self._drop(run) if result.reason == "rejected" else 0
                again = self._retry and ending == "flown" and run.batch.stuck(episode)
                if again:
                    self._todo.appendleft((run, episode))
                on_end(EndedFlight(run=run, result=result, again=again, dropped=dropped))
        finally:
            engine.close()
        return ending

    def _drop(self, rejected: OpenRun) -> int:
        """Remove the remaining flights of all runs with the same models as this run; return their number."""
        models, before = rejected.entry.flight.models, len(self._todo)
        self._todo = deque((run, episode) for run, episode in self._todo if run.entry.flight.models != models)
        return before - len(self._todo)

    def _sortie(self, run: OpenRun, episode: str) -> Sortie:
        with file_errors_as(InfrastructureError, f"{run.batch.run} cannot be written"):
            folder = run.batch.fresh(episode)
        flight = replace(run.entry.flight, episode=None, record=run.batch.record(episode))
        return Sortie(flight=flight, folder=folder)


def _in_order(runs: Sequence[OpenRun], retry: bool) -> Iterator[tuple[OpenRun, str]]:
    """Yield the remaining flights, run after run. Runs with the same label `beside` take turns after each episode."""
    groups: dict[str, list[OpenRun]] = {}
    for run in runs:
        groups.setdefault(f"beside {run.entry.beside}" if run.entry.beside else f"run {run.entry.name}", []).append(run)
    for group in groups.values():
        left = {run.entry.name: frozenset(run.batch.left(run.part, retry=retry)) for run in group}
        for episode in dict.fromkeys(episode for run in group for episode in run.part):
            yield from ((run, episode) for run in group if episode in left[run.entry.name])


def fly_run(
    batch: Batch,
    flight: FlightSpec,
    episodes: Sequence[str],
    jobs: int,
    on_end: Callable[[EndedFlight], None] = lambda flight: None,
) -> list[Result]:
    """Fly the episodes that are not done, once each, and return the results in the order in which they ended.

    `flight`: the settings of each flight, without the episode. Raises the errors of `Campaign.fly`.
    """
    results: list[Result] = []

    def take(ended: EndedFlight) -> None:
        results.append(ended.result)
        on_end(ended)

    entry = BenchEntry(name=batch.run.name, flight=flight, episodes=tuple(episodes))
    campaign = Campaign([OpenRun(entry=entry, batch=batch, part=entry.episodes)], jobs=jobs, retry=False)
    if campaign.left:
        campaign.fly(LocalEngine(batch.run / "worker.log", min(jobs, len(campaign.left))), take)
    return results
