"""Reads and writes study.json in a study's folder, and checks that a study may resume there.

The folder also has bench.json and the runs. docs/studies.md specifies study.json.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_redacted_json
from dronecats.report.results.identity import leaves
from dronecats.study.factors import factor_of, level_text
from dronecats.study.plan import StudyPlan
from foundation.errors import UsageError
from foundation.files import file_errors_as, write_json
from foundation.run_folder import layout
from foundation.run_folder.folder import PER_EPISODE, PER_RESUME
from foundation.run_folder.reading import json_object, parse_row
from foundation.run_folder.results import Level, Study, StudyFactor, StudyRun
from foundation.run_folder.writing import as_json


def read(folder: Path) -> Study:
    """Return the study of a folder. Raises UsageError if there is none or a value in it is not valid."""
    path = folder / layout.STUDY
    value = json_object(path)
    if value is None:
        raise UsageError(f"{folder} is not a study: it has no readable {layout.STUDY}")
    study, problem = parse_row(value, Study)
    if study is None:
        raise UsageError(f"{path}: {problem}")
    try:
        return _checked(study)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def write(folder: Path, study: Study) -> None:
    """Write study.json. Raises UsageError if the folder cannot be written."""
    with file_errors_as(UsageError, f"the folder {folder} cannot be written", ". Choose another --out"):
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / layout.STUDY, as_json(study))


def _checked(study: Study) -> Study:
    """Return a study with levels that the factors have validated. Raises UsageError for an invalid level."""
    factors = tuple(replace(factor, levels=tuple(_levels(factor))) for factor in study.factors)
    levels_of = {factor.name: factor.levels for factor in factors}
    runs = tuple(replace(run, levels=_at(run.levels, f"{run.name}: ")) for run in study.runs)
    for run in runs:
        if strange := next((name for name, level in run.levels.items() if level not in levels_of.get(name, ())), None):
            raise UsageError(f"{run.name}: {strange} {run.levels[strange]} is not a level of the study")
    return replace(study, factors=factors, held=_at(study.held, "held: "), runs=runs)


def _levels(declared: StudyFactor) -> Iterator[Level]:
    factor = factor_of(declared.name)
    if not declared.levels:
        raise UsageError(f"{declared.name} has no level")
    for level in declared.levels:
        yield factor.level(level)


def _at(levels: Mapping[str, Level], where: str) -> dict[str, Level]:
    try:
        return {name: factor_of(name).level(level) for name, level in levels.items()}
    except UsageError as error:
        raise UsageError(f"{where}{error}") from None


MERGED_FIELDS = ("flights", "runs")  # fields of Study that may change when a study resumes
PILOT_FIELDS = ("pilot", "model", "outside", "commander", "scripted")  # fields of a flight; may differ between pilots
RENDERED = "simulated.rendered"  # may differ between pilots too, because only some pilots need pictures
SHOWN_MAX = 3  # an error message lists at most this many differences


def merge_earlier_runs(folder: Path, plan: StudyPlan) -> Study:
    """Return the planned study and the runs in the folder's study.json that the plan lacks, such as other pilots' runs.

    Raises UsageError if the folder holds a benchmark, another study, or flights that differ from the planned ones.
    """
    study = plan.study
    if not (folder / layout.STUDY).exists():
        if (folder / layout.BENCH).exists():
            raise UsageError(f"{folder} is a benchmark, not a study. Choose another --out")
        return study
    before = read(folder)
    fields_compared = [field.name for field in fields(Study) if field.name not in MERGED_FIELDS]
    changes = [_difference_text(name, getattr(before, name), getattr(study, name)) for name in fields_compared]
    if any(changes):
        text = "; ".join(filter(None, changes))
        raise UsageError(f"{folder} has another study (different: {text}). Choose another --out")
    _check_flights(folder, before, plan)
    names = {run.name for run in study.runs}
    kept = tuple(run for run in before.runs if run.name not in names)
    return replace(study, flights=max(study.flights, before.flights), runs=(*study.runs, *kept))


def _difference_text(name: str, before: Any, after: Any) -> str | None:
    """Return a text with the field and its values in two studies; None if the values are equal."""
    if before == after:
        return None
    if name in ("cells", "episodes"):
        removed = [f"{value} is missing in the new study" for value in before if value not in after]
        added = [f"{value} is missing in the stored study" for value in after if value not in before]
        return f"{name}, {', '.join([*removed, *added][:SHOWN_MAX]) or 'in another order'}"
    return f"{name}, {_value_text(before)} in the stored study and {_value_text(after)} in the new one"


def _value_text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {level_text(level)}" for name, level in value.items()) or "nothing"
    if isinstance(value, tuple):
        return " and ".join(_factor_text(factor) for factor in value)
    return f"'{value}'"


def _factor_text(factor: StudyFactor) -> str:
    levels = [level_text(level) for level in factor.levels]
    return f"{factor.name} {', '.join(levels if len(levels) <= 2 * SHOWN_MAX else [*levels[:SHOWN_MAX], '…'])}"


def _check_flights(folder: Path, before: Study, plan: StudyPlan) -> None:
    """Raise UsageError if a recorded flight differs from the planned one.

    A resumed study skips recorded flights, so these must equal the planned ones. A run is compared with the recorded
    run of the same name or, except for PILOT_FIELDS and RENDERED, with another pilot's run at the same levels.
    """
    by_name = {run.name: run for run in before.runs}
    bench = json_object(folder / layout.BENCH) or {}
    kept_flights = {run.get("name"): run.get("flight") for run in bench.get("runs", ())}
    by_place: dict[str, str] = {}  # _point_key → name of the first recorded run with this key
    for run in before.runs:
        by_place.setdefault(_point_key(run), run.name)
    for entry, run in zip(plan.entries, plan.study.runs, strict=True):
        run_name = run.name if run.name in by_name else by_place.get(_point_key(run))
        flight = kept_flights.get(run_name)
        if run_name is None or not isinstance(flight, dict):
            continue
        if by_name[run_name].levels != run.levels:
            raise UsageError(f"{folder / run_name} has other levels than {run.name} now. Choose another --out")
        differences = list(_flight_differences(flight, entry.flight, same_pilot=run_name == run.name))
        if differences:
            text = "; ".join(differences[:SHOWN_MAX])
            raise UsageError(
                f"{folder / run_name} was started with another {text}. Use the same options again, or another --out"
            )


def _point_key(run: StudyRun) -> str:
    levels: dict[str, Level] = dict(sorted(run.levels.items()))
    return json.dumps([run.flight_number, levels])


def _flight_differences(then: dict[str, Any], now: FlightSpec, *, same_pilot: bool) -> Iterator[str]:
    """Yield a text for each field in which a recorded and a planned flight differ, with both values."""
    left = (*PER_EPISODE, *PER_RESUME, *(() if same_pilot else PILOT_FIELDS))
    flights = then, json.loads(json.dumps(as_redacted_json(now)))
    before, after = (dict(leaves({k: v for k, v in flight.items() if k not in left})) for flight in flights)
    for name in dict.fromkeys((*before, *after)):
        if before.get(name) != after.get(name) and (same_pilot or name != RENDERED):
            in_folder, in_command = _short_json(before.get(name)), _short_json(after.get(name))
            yield f"{name}, {in_folder} in the folder and {in_command} in this command"


def _short_json(value: Any) -> str:
    text = "none" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:40]}…"
