"""A run of many episodes on disk: which are done, which did not move, and what a kill has left half flown.

Nothing is remembered but in the folder, and every step of it is one rename or one file that is whole or not there. So a
process that is killed at any moment loses what it had in the air, and nothing else.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from dronecats.judge.metrics.stuck import is_stuck, poses_of, track_m
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.folder import LOCK, differences, hold, prepare, write_run
from foundation.run_folder.reading import json_object
from foundation.run_folder.results import SCORED
from foundation.whole_file import write_json

RETRIED = "retried"  # folder of the run that keeps the flights that did not move, each with another in its place


class Batch:
    """The run folder. An episode, whatever id or file it is asked for by, has the folder that its record's id names.

    It is done when that folder holds the very record with a verdict of success or failure.
    """

    def __init__(self, run: Path, configuration: Mapping[str, Any]) -> None:
        """Make the folder, or go on with the one that stands there.

        Raises UsageError when it belongs to another configuration or cannot be written.
        """
        self.run = run
        self._records: dict[str, EpisodeRecord] = {}
        try:
            run.mkdir(parents=True, exist_ok=True)
            self._lock = hold(run / LOCK, run)
            before = json_object(run / layout.RUN)
            if before is not None:
                other = differences(before, configuration)
                if other:
                    raise UsageError(f"{run} is a run with another {', '.join(other)}; choose another --out")
            elif any(path.name != LOCK for path in run.iterdir()):
                raise UsageError(f"{run} is not empty and has no run.json; choose another --out")
            write_run(run, dict(configuration))
        except OSError as error:
            raise UsageError(f"the run folder {run} cannot be written: {error.strerror}") from None

    def close(self) -> None:
        """Let another process go on with the run."""
        self._lock.close()

    def folder(self, episode: str) -> Path:
        """Return where an episode is kept. Raises UsageError when its record cannot be read."""
        return self.run / self._record(episode).id

    def record(self, episode: str) -> dict[str, Any]:
        """Return an episode's record as JSON values. Raises UsageError when it cannot be read."""
        return dict(json.loads(self._record(episode).to_json()))

    def done(self, episode: str) -> dict[str, Any] | None:
        """Return the verdict of an episode that has been flown to its end as its record is now, None for any other."""
        folder = self.folder(episode)
        if json_object(folder / layout.EPISODE) != self.record(episode):
            return None
        verdict = json_object(folder / layout.VERDICT)
        return verdict if verdict is not None and verdict.get("outcome") in SCORED else None

    def left(self, episodes: Iterable[str], *, retry: bool = False) -> list[str]:
        """Return the episodes that are still to be flown, in their order; with `retry` those that are stuck, too."""
        return [each for each in episodes if self.done(each) is None or (retry and self.stuck(each))]

    def stuck(self, episode: str) -> bool:
        """Return whether an episode has failed without moving, and was not flown once more for that yet."""
        folder, verdict = self.folder(episode), self.done(episode)
        if verdict is None or verdict["outcome"] == "success" or self.retried(episode):
            return False
        try:
            return is_stuck(poses_of(folder))
        except UsageError:  # a damaged log, which the verdict tells of
            return False

    def retried(self, episode: str) -> bool:
        """Return whether an episode, as its record is now, has been flown once more because it did not move."""
        name, record = self.folder(episode).name, self.record(episode)
        before = [self.run / RETRIED / name, *(self.run / RETRIED).glob(f"{name}-[0-9]*")]
        return any(json_object(each / layout.EPISODE) == record for each in before)

    def fresh(self, episode: str) -> Path:
        """Return an empty folder for an episode.

        What an earlier attempt has left is kept under `unfinished`, and a flight that did not move under `retried`.
        Raises OSError when the disk does not take it.
        """
        folder = self.folder(episode)
        if folder.exists():
            kept = self.run / (RETRIED if self.stuck(episode) else layout.UNFINISHED)
            kept.mkdir(exist_ok=True)
            folder.rename(_free(kept, folder.name, bare=kept.name == RETRIED))
        prepare(folder)
        if (self.run / RETRIED).is_dir():
            write_json(self.run / layout.RETRIES, self._retries())
        return folder

    def _retries(self) -> dict[str, Any]:
        """Return what retries.json holds: of each episode that was flown once more, what the first flight came to."""
        told: dict[str, Any] = {}
        for before in sorted((self.run / RETRIED).iterdir()):
            verdict = json_object(before / layout.VERDICT) or {}
            told[before.name] = {
                "outcome": verdict.get("outcome"),
                "track_m": round(track_m(poses_of(before)) or 0.0, 3),
            }
        return told

    def _record(self, episode: str) -> EpisodeRecord:
        if episode not in self._records:
            self._records[episode] = catalogue.load(episode)
        return self._records[episode]


def _free(folder: Path, name: str, *, bare: bool) -> Path:
    """Return a place for something in a folder: under its name where that may be `bare`, or with the next number."""
    if bare and not (folder / name).exists():
        return folder / name
    number = 1
    while (folder / f"{name}-{number}").exists():
        number += 1
    return folder / f"{name}-{number}"
