"""A study's folder: study.json beside bench.json and the runs. Contract: docs/studies.md."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from dronecats.study.factors import factor_of
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.benchmark import Level as Level
from foundation.run_folder.benchmark import Study as Study
from foundation.run_folder.benchmark import StudyFactor as StudyFactor
from foundation.run_folder.benchmark import StudyRun as StudyRun
from foundation.run_folder.damage import taken
from foundation.run_folder.reading import json_object
from foundation.run_folder.writing import as_json
from foundation.whole_file import write_json


def read(folder: Path) -> Study:
    """Return the study of a folder. Raises UsageError where there is none, it cannot be one, or a level is none."""
    path = folder / layout.STUDY
    value = json_object(path)
    if value is None:
        raise UsageError(f"{folder} is no study: there is no {layout.STUDY} in it that can be read")
    study, wrong = taken(value, Study)
    if study is None:
        raise UsageError(f"{path}: {wrong}")
    try:
        return _checked(study)
    except UsageError as wrong_level:
        raise UsageError(f"{path}: {wrong_level}") from None


def _checked(study: Study) -> Study:
    """Return a study with each level as its factor has it. Raises UsageError for what is no level of it."""
    factors = tuple(replace(each, levels=tuple(_levels(each))) for each in study.factors)
    known = {each.name: each.levels for each in factors}
    runs = tuple(replace(run, levels=_at(run.levels, f"{run.name}: ")) for run in study.runs)
    for run in runs:
        if strange := next((name for name, level in run.levels.items() if level not in known.get(name, ())), None):
            raise UsageError(f"{run.name}: {strange} {run.levels[strange]} is none of the study's levels")
    return replace(study, factors=factors, held=_at(study.held, "held: "), runs=runs)


def _levels(told: StudyFactor) -> Iterator[Level]:
    factor = factor_of(told.name)
    if not told.levels:
        raise UsageError(f"{told.name} has no level")
    for level in told.levels:
        yield factor.level(level)


def _at(levels: Mapping[str, Level], where: str) -> dict[str, Level]:
    try:
        return {name: factor_of(name).level(level) for name, level in levels.items()}
    except UsageError as wrong:
        raise UsageError(f"{where}{wrong}") from None


def write(folder: Path, study: Study) -> None:
    """Write study.json. Raises UsageError where the folder does not take it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / layout.STUDY, as_json(study))
    except OSError as error:
        raise UsageError(f"the folder {folder} cannot be written: {error.strerror}; choose another --out") from None
