"""How much of the benchmarks of some runs has been flown: one in mid-flight is no sample of its suite."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report.recorded.run import RecordedRun
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object


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
