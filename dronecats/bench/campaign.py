"""Many flights of many runs: begun in order, flown again where they did not move, stopped when the money is gone."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from dronecats.agent.models.model import ModelSpec
from dronecats.bench.batch import Batch
from dronecats.bench.engine import Engine, Sortie
from dronecats.bench.matrix import BenchEntry
from foundation.errors import InfrastructureError
from foundation.run_folder.results import Result

Ending = Literal["flown", "budget"]


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenRun:
    """A run with its folder, which nobody else flies meanwhile."""

    entry: BenchEntry
    batch: Batch
    part: tuple[str, ...]  # ids or files, those of its episodes that are flown here and now


@dataclass(frozen=True, slots=True, kw_only=True)
class Came:
    """What came of a flight."""

    run: OpenRun
    result: Result
    again: bool  # it did not move, and is flown once more: this is not its result
    dropped: int = 0  # flights of the same model that are not begun, since its endpoint rejects every question


class Campaign:
    """What is still to be flown of some runs. Nothing of it is kept but in their folders."""

    def __init__(self, runs: Sequence[OpenRun], *, jobs: int, retry: bool = True) -> None:
        """`jobs`: flights in the air at a time. `retry`: fly what did not move once more."""
        self._jobs, self._retry = max(1, jobs), retry
        self._todo = deque(_in_order(runs, retry))

    @property
    def left(self) -> frozenset[tuple[str, str]]:
        """What is still to be flown: (run, episode) by name, those among them that are flown once more."""
        return frozenset((run.entry.name, episode) for run, episode in self._todo)

    def fly(self, engine: Engine, on_came: Callable[[Came], None] = lambda came: None) -> Ending:
        """Fly them, and return whether all were, or what they may cost is spent. Closes the engine.

        `on_came` is called in the caller's thread as each ends. What goes wrong with one flight is its result. Raises
        DronecatsError when nothing can be flown any more, and lets KeyboardInterrupt through.
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
                landed = engine.landed()
                run, episode = flying.pop(landed.sortie.folder)
                if landed.result.reason == "budget":
                    ending = "budget"
                    self._todo.clear()
                dropped = self._drop(run) if landed.result.reason == "rejected" else 0
                again = self._retry and ending == "flown" and run.batch.stuck(episode)
                if again:
                    self._todo.appendleft((run, episode))
                on_came(Came(run=run, result=landed.result, again=again, dropped=dropped))
        finally:
            engine.close()
        return ending

    def _drop(self, rejected: OpenRun) -> int:
        """Begin no other flight of the models of a run; return how many flights that leaves out."""
        models, before = _models(rejected), len(self._todo)
        self._todo = deque((run, episode) for run, episode in self._todo if _models(run) != models)
        return before - len(self._todo)

    def _sortie(self, run: OpenRun, episode: str) -> Sortie:
        try:
            folder = run.batch.fresh(episode)
        except OSError as full:
            raise InfrastructureError(f"{run.batch.run} cannot be written: {full.strerror}") from None
        flight = replace(run.entry.flight, episode=None, record=run.batch.record(episode))
        return Sortie(flight=flight, folder=folder)


def _models(run: OpenRun) -> tuple[ModelSpec | None, ModelSpec | None]:
    """Return the model that flies a run, and the one that commands it."""
    return run.entry.flight.model, run.entry.flight.commander


def _in_order(runs: Sequence[OpenRun], retry: bool) -> Iterator[tuple[OpenRun, str]]:
    """Yield what is left: run after run, and of runs that are flown side by side episode after episode."""
    groups: dict[str, list[OpenRun]] = {}
    for run in runs:
        groups.setdefault(f"beside {run.entry.beside}" if run.entry.beside else f"run {run.entry.name}", []).append(run)
    for group in groups.values():
        left = {run.entry.name: frozenset(run.batch.left(run.part, retry=retry)) for run in group}
        for episode in dict.fromkeys(episode for run in group for episode in run.part):
            yield from ((run, episode) for run in group if episode in left[run.entry.name])
