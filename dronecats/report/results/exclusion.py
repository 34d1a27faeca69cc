"""Flights that a report leaves out by the value of a metric, such as those with more than two estimator resets.

The choice is the reader's, never the default, and every report tells it: what is left out by something that happened in
a flight may be left out at one level of a study more often than at another.

Benchmarks of which flights are missing are found here, too: one in mid-flight is no sample of its suite.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dronecats.judge.metrics.registry import METRICS
from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.collection import Collection, ScoredEpisode
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object


@dataclass(frozen=True, slots=True)
class Exclusion:
    """Leaves out the flights in which a metric is above a number."""

    metric: str  # a name of the registry
    most: float  # in the metric's unit

    def __str__(self) -> str:
        return f"{self.metric} above {self.most:g}"

    def value(self, scored: ScoredEpisode) -> float | None:
        """Return the metric of a flight; None where the flight does not tell it."""
        value = scored.values.get(self.metric)
        return None if value is None else float(value)

    def excludes(self, scored: ScoredEpisode) -> bool:
        """Return whether a flight is left out."""
        value = self.value(scored)
        return value is not None and value > self.most


def parse_exclusion(text: str) -> Exclusion:
    """Return what `--exclude-above` says, METRIC=N. Raises UsageError."""
    name, equals, number = text.partition("=")
    example = "for example estimator_resets=2"
    if not equals:
        raise UsageError(f"--exclude-above wants METRIC=N, {example}, got '{text:.60}'")
    if name not in METRICS or METRICS[name].level != "episode":
        raise UsageError(f"--exclude-above: '{name:.60}' is no metric of an episode, {example}; see docs/metrics.md")
    try:
        most = float(number)
    except ValueError:
        most = math.nan
    if not math.isfinite(most):
        raise UsageError(f"--exclude-above {name} wants a number, {example}, got '{number:.60}'")
    return Exclusion(name, most)


def exclude(collection: Collection, exclusions: Sequence[Exclusion]) -> Collection:
    """Return the collection with the flights beyond any of the exclusions left uncounted."""
    return replace(collection, episodes=tuple(_excluded(each, exclusions) for each in collection.episodes))


def _excluded(scored: ScoredEpisode, exclusions: Sequence[Exclusion]) -> ScoredEpisode:
    beyond = next((each for each in exclusions if each.excludes(scored)), None) if scored.scored else None
    if beyond is None:
        return scored
    return replace(
        scored,
        left_out=str(beyond),
        error=f"left out: {beyond.metric} is {beyond.value(scored):g}, above {beyond.most:g}",
    )


def exclusion_sentences(flights: Sequence[ScoredEpisode], exclusions: Sequence[Exclusion]) -> Iterator[str]:
    """Yield what a report tells of the flights that it leaves out, sentences."""
    left_out = Counter(each.left_out for each in flights if each.left_out)
    for exclusion in exclusions:  # one that leaves out nothing is told as well
        left_out.setdefault(str(exclusion), 0)
    for reason, count in left_out.items():
        yield f"Left out: {count} of {len(flights)} flights: {reason}."
    for exclusion in exclusions:
        untold = sum(each.scored and exclusion.value(each) is None for each in flights)
        if untold:
            yield f"{untold} flights do not tell {exclusion.metric} and are counted."


@dataclass(frozen=True, slots=True)
class Unflown:
    """What is missing of one benchmark."""

    folder: Path  # of bench.json
    flights: int  # that belong to it
    missing: int  # of these, those that no folder here holds


def unflown(runs: Iterable[RecordedRun]) -> list[Unflown]:
    """Return the benchmarks of which flights are missing; one whose bench.json is damaged tells nothing."""
    flown: dict[Path, dict[str, set[str]]] = {}
    for run in runs:
        flown.setdefault(run.folder.parent, {})[run.folder.name] = {folder.name for folder in run.episodes}
    found = [_of(folder, json_object(folder / layout.BENCH) or {}, there) for folder, there in flown.items()]
    return [each for each in found if each.missing]


def _of(folder: Path, benchmark: Mapping[str, Any], flown: Mapping[str, set[str]]) -> Unflown:
    told = [run for run in benchmark.get("runs") or () if isinstance(run, dict)]
    belong = {str(run.get("name")): set(run.get("episodes") or ()) for run in told}
    missing = sum(len(ids - flown.get(name, set())) for name, ids in belong.items())
    return Unflown(folder, sum(map(len, belong.values())), missing)
