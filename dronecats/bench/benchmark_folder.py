"""A benchmark's folder: bench.json, a run folder for each of its runs, and one ledger for all of them."""

from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.bench.campaign import Batch, OpenRun
from dronecats.bench.matrix import BenchEntry, ChosenSuite, benchmark, part_of
from dronecats.bench.summary import EpisodeScore, score
from dronecats.flight.run.first_question import FirstQuestions
from dronecats.flight.run.settings import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.spec_file import as_kept
from dronecats.pilots import roster
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.folder import write_json
from foundation.run_folder.reading import json_object, stored_result
from foundation.run_folder.results import Result
from foundation.run_folder.writing import as_json


class Bench:
    """The open folder. Gone on with as it stands: what it holds of other runs stays."""

    def __init__(
        self,
        out: Path,
        suite: ChosenSuite,
        entries: Sequence[BenchEntry],
        *,
        retry: bool,
        limit: int | None = None,
        shard: tuple[int, int] | None = None,
        first: Callable[[], None] = lambda: None,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        """`limit` and `shard`: how much of it is flown here and now. Raises UsageError, InfrastructureError.

        `first` is called when it is known that all can be flown, before bench.json is written: each run that stands
        there is opened as what is asked for now. New ones are made after that, so that a kill leaves none untold. Each
        model that is still to fly is asked one small question before that; `say` takes the lines about it.
        """
        self.out = out
        self._opened = ExitStack()
        part = set(part_of(tuple(suite.records), limit, shard))
        try:
            for entry in entries:
                instructions = [suite.records[each].instruction for each in entry.episodes if each in part]
                roster.check_installed(entry.flight.pilot or "", instructions)
            configurations = _configurations(suite, entries)
            told = self._joined(as_json(benchmark(suite, entries, retry=retry)))
            asked = list(zip(entries, configurations, strict=True))
            open_ones = {entry.name: self._batch(entry, one) for entry, one in asked if (out / entry.name).exists()}
            flights = [e.flight for e in entries if self._has_left(open_ones.get(e.name), e, part, retry)]
            questions = FirstQuestions(flights, out, say)
            questions.ask()
            self._keep(told, first)
            questions.book(out)
            open_ones |= {entry.name: self._batch(entry, one) for entry, one in asked if entry.name not in open_ones}
            self.runs = tuple(
                OpenRun(
                    entry=entry,
                    batch=open_ones[entry.name],
                    part=tuple(each for each in entry.episodes if each in part),
                )
                for entry in entries
            )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let another process go on with it."""
        self._opened.close()

    def stored(self) -> list[tuple[OpenRun, str, Result]]:
        """Return (run, episode, result) of every episode of this part that has been flown to its end."""
        return [
            (run, episode, stored_result(run.batch.folder(episode).name, run.batch.folder(episode)))
            for run in self.runs
            for episode in run.part
            if run.batch.done(episode) is not None
        ]

    def scores(self, broken: Callable[[OpenRun, str], Result | None]) -> list[EpisodeScore]:
        """Return what the part that was asked for has come to; `broken` gives the error of a flight that broke off."""
        found = []
        flown = {(run.entry.name, episode): result for run, episode, result in self.stored()}
        for run in self.runs:
            for episode in run.part:
                result = flown.get((run.entry.name, episode)) or broken(run, episode)
                if result is not None:
                    retried, folder = run.batch.retried(episode), run.batch.folder(episode)
                    found.append(score(setting_of(run.entry), run.entry.flight, folder, result, retried=retried))
        return found

    @staticmethod
    def _has_left(batch: Batch | None, entry: BenchEntry, part: Collection[str], retry: bool) -> bool:
        """Return whether something of a run is still to be flown; `batch` None: it was not begun."""
        asked = [each for each in entry.episodes if each in part]
        return bool(asked if batch is None else batch.left(asked, retry=retry))

    def _batch(self, entry: BenchEntry, configuration: dict[str, Any]) -> Batch:
        batch = Batch(self.out / entry.name, configuration)
        self._opened.callback(batch.close)
        return batch

    def _joined(self, now: dict[str, Any]) -> dict[str, Any]:
        """Return what bench.json is to say: what is asked for now, and behind it the runs that stand there besides."""
        try:
            before = json_object(self.out / layout.BENCH)
            stands = self.out.iterdir() if self.out.exists() else ()
            if before is None and any(not path.name.startswith(layout.STUDY) for path in stands):
                raise UsageError(f"{self.out} is not empty and has no {layout.BENCH}; choose another --out")
        except OSError as error:
            raise _unwritable(self.out, error) from None
        if before is not None and before.get("suite") != now["suite"]:
            raise UsageError(f"{self.out} is a benchmark of other episodes; choose another --out")
        names = {run["name"] for run in now["runs"]}
        others = [run for run in (before or {}).get("runs", ()) if run.get("name") not in names]
        return {**now, "runs": [*now["runs"], *others]}

    def _keep(self, told: dict[str, Any], first: Callable[[], None]) -> None:
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            first()
            write_json(self.out / layout.BENCH, told)
        except OSError as error:
            raise _unwritable(self.out, error) from None


def _unwritable(folder: Path, error: OSError) -> UsageError:
    return UsageError(f"the folder {folder} cannot be written: {error.strerror}; choose another --out")


def setting_of(entry: BenchEntry) -> str:
    """Return a run's name without the number of its flight: what is pooled over flights."""
    return entry.name.rpartition("-f")[0]


def _configurations(suite: ChosenSuite, entries: Sequence[BenchEntry]) -> list[dict[str, Any]]:
    """Return what each run.json holds. Raises UsageError."""
    found = []
    for entry in entries:
        spec = entry.flight  # looked up without its ledger, which is made with the folder
        flight = look_up(replace(spec, accounts=replace(spec.accounts, ledger=None)))
        told = settings(flight, flight.camera)
        found.append({**told, "flight": as_kept(spec), "suite": as_json(suite.flown)})
    return found
