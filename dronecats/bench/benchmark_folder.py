"""The folder of a benchmark: bench.json, a folder per run, and one ledger for all runs."""

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.bench.campaign import Batch, OpenRun
from dronecats.bench.matrix import BenchEntry, ChosenSuite, benchmark, part_of
from dronecats.bench.tables import EpisodeScore, score
from dronecats.flight.run.accounts import FirstQuestions
from dronecats.flight.run.fly import settings
from dronecats.flight.spec.flight import look_up
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.pilots import roster
from foundation.errors import UsageError
from foundation.files import file_errors_as, write_json
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object, stored_result
from foundation.run_folder.results import Result
from foundation.run_folder.writing import as_json


class Bench:
    """An open benchmark folder. An existing folder is resumed; runs that are not in `entries` stay in it."""

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
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        """`limit` and `shard` select the episodes that this process flies. `retry`: repeat flights that did not move.

        The order: check existing run folders; send a test question to each model with flights left (`report` gets the
        results); call `first` (writes a study's file); write bench.json; create new run folders. So bench.json names
        every run folder even after a kill. Raises UsageError, ModelError, InfrastructureError.
        """
        self.out = out
        self._opened = ExitStack()
        part = set(part_of(tuple(suite.records), limit, shard))
        try:
            for entry in entries:
                instructions = [suite.records[name].instruction for name in entry.episodes if name in part]
                roster.check_installed(entry.flight.pilot or "", instructions)
            configurations = [(entry, _configuration(suite, entry.flight)) for entry in entries]
            manifest = self._with_other_runs(as_json(benchmark(suite, entries, retry=retry)))
            batches = {e.name: self._batch(e, c) for e, c in configurations if (out / e.name).exists()}
            flights = [e.flight for e in entries if self._has_left(batches.get(e.name), e, part, retry)]
            questions = FirstQuestions(flights, out, report)
            questions.ask()
            self._write(manifest, first)
            questions.book(out)
            batches |= {e.name: self._batch(e, c) for e, c in configurations if e.name not in batches}
            self.runs = tuple(
                OpenRun(
                    entry=entry,
                    batch=batches[entry.name],
                    part=tuple(episode for episode in entry.episodes if episode in part),
                )
                for entry in entries
            )
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the folder for another process."""
        self._opened.close()

    def stored(self) -> list[tuple[OpenRun, str, Result]]:
        """Return (run, episode, result) of every selected episode that is done."""
        return [
            (run, episode, stored_result(run.batch.folder(episode).name, run.batch.folder(episode)))
            for run in self.runs
            for episode in run.part
            if run.batch.done(episode) is not None
        ]

    def scores(self, broken: Callable[[OpenRun, str], Result | None]) -> list[EpisodeScore]:
        """Return the scores of the selected episodes that have a result.

        `broken` returns the result of an episode whose flight ended in an error; None if no flight did.
        """
        scores = []
        stored = {(run.entry.name, episode): result for run, episode, result in self.stored()}
        for run in self.runs:
            for episode in run.part:
                result = stored.get((run.entry.name, episode)) or broken(run, episode)
                if result is not None:
                    retried, folder = run.batch.retried(episode), run.batch.folder(episode)
                    scores.append(score(setting_of(run.entry), run.entry.flight, folder, result, retried=retried))
        return scores

    @staticmethod
    def _has_left(batch: Batch | None, entry: BenchEntry, part: Collection[str], retry: bool) -> bool:
        """Return whether a run has flights left. `batch` None: the run has not begun."""
        episodes = [episode for episode in entry.episodes if episode in part]
        return bool(episodes if batch is None else batch.left(episodes, retry=retry))

    def _batch(self, entry: BenchEntry, configuration: dict[str, Any]) -> Batch:
        batch = Batch(self.out / entry.name, configuration)
        self._opened.callback(batch.close)
        return batch

    def _with_other_runs(self, now: dict[str, Any]) -> dict[str, Any]:
        """Return the contents of bench.json: the runs of `now`, then the other runs of the existing file."""
        with _folder_errors(self.out):
            before = json_object(self.out / layout.BENCH)
            paths = self.out.iterdir() if self.out.exists() else ()
            if before is None and any(not path.name.startswith(layout.STUDY) for path in paths):
                raise UsageError(
                    f"{self.out} is not empty and has no {layout.BENCH}, so it is not a benchmark. Choose another --out"
                )
        if before is not None and before.get("suite") != now["suite"]:
            raise UsageError(f"{self.out} is a benchmark with other episodes. Choose another --out")
        names = {run["name"] for run in now["runs"]}
        kept = [run for run in (before or {}).get("runs", ()) if run.get("name") not in names]
        return {**now, "runs": [*now["runs"], *kept]}

    def _write(self, manifest: dict[str, Any], first: Callable[[], None]) -> None:
        with _folder_errors(self.out):
            self.out.mkdir(parents=True, exist_ok=True)
            first()
            write_json(self.out / layout.BENCH, manifest)


def _folder_errors(folder: Path) -> AbstractContextManager[None]:
    return file_errors_as(UsageError, f"the folder {folder} cannot be written", ". Choose another --out")


def setting_of(entry: BenchEntry) -> str:
    """Return the setting of a run: its name without the flight number. Tables pool the flights of one setting."""
    return entry.name.rpartition("-f")[0]


def _configuration(suite: ChosenSuite, spec: FlightSpec) -> dict[str, Any]:
    """Return the contents of a run's run.json. Raises UsageError."""
    # without the ledger, because `look_up` opens it and its folder may not exist yet
    flight = look_up(replace(spec, accounts=replace(spec.accounts, ledger=None)))
    return {**settings(flight, flight.camera), "flight": as_redacted_json(spec), "suite": as_json(suite.identity)}
