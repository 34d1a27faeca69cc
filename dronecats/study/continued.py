"""A study gone on with: only as what it was begun as, flight by flight, and told in one sentence where it is not."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_kept
from dronecats.study import folder as folders
from dronecats.study.factors import said
from dronecats.study.plan import StudyPlan
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.benchmark import Level, Study, StudyFactor, StudyRun
from foundation.run_folder.folder import PER_EPISODE, PER_SITTING
from foundation.run_folder.reading import json_object

GROWS = ("flights", "runs")  # in which a study may be gone on with
WHO = ("pilot", "model", "outside", "commander", "scripted")  # in which the flights of two pilots differ, …
LOOKING = "simulated.rendered"  # … and what follows from that
TOLD = 3  # differences that a sentence names


def joined(folder: Path, made: StudyPlan) -> Study:
    """Return a study with the runs that stand in a folder besides, of more flights or other pilots.

    Raises UsageError for a folder of another study, of none, or of flights that are flown otherwise than these.
    """
    study = made.study
    if not (folder / layout.STUDY).exists():
        if (folder / layout.BENCH).exists():
            raise UsageError(f"{folder} is a benchmark and no study; choose another --out")
        return study
    before = folders.read(folder)
    names = [each.name for each in fields(Study) if each.name not in GROWS]
    other = [_differing(name, getattr(before, name), getattr(study, name)) for name in names]
    if any(other):
        told = "; ".join(filter(None, other))
        raise UsageError(f"{folder} is of another study (not the same: {told}); choose another --out")
    _check_flights(folder, before, made)
    mine = {run.name for run in study.runs}
    kept = tuple(run for run in before.runs if run.name not in mine)
    return replace(study, flights=max(study.flights, before.flights), runs=(*study.runs, *kept))


def _differing(name: str, then: Any, now: Any) -> str | None:
    """Return a field of two studies, with what it is in each; None where that is the same."""
    if then == now:
        return None
    if name in ("cells", "episodes"):
        gone = [f"no {each} now" for each in then if each not in now]
        come = [f"no {each} there" for each in now if each not in then]
        return f"{name}, {', '.join([*gone, *come][:TOLD]) or 'in another order'}"
    return f"{name}, {_words(then)} there and {_words(now)} now"


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {said(level)}" for name, level in value.items()) or "nothing"
    if isinstance(value, tuple):
        return " and ".join(_axis(each) for each in value)
    return f"'{value}'"


def _axis(factor: StudyFactor) -> str:
    levels = [said(level) for level in factor.levels]
    return f"{factor.name} {', '.join(levels if len(levels) <= 2 * TOLD else [*levels[:TOLD], '…'])}"


def _check_flights(folder: Path, before: Study, made: StudyPlan) -> None:
    """Raise UsageError where a flight of the folder differs from what is asked for now, but for who flies it.

    Those of one name by anything; those of other pilots at the same levels by all that is not the pilot's. So no
    flight is taken for done that was another one, and all pilots of a study fly the same.
    """
    stood = {run.name: run for run in before.runs}
    flown = {run.get("name"): run.get("flight") for run in (json_object(folder / layout.BENCH) or {}).get("runs", ())}
    beside: dict[str, str] = {}  # a run of the folder at each point and number of the flight
    for run in before.runs:
        beside.setdefault(_place(run), run.name)
    for entry, run in zip(made.entries, made.study.runs, strict=True):
        there = run.name if run.name in stood else beside.get(_place(run))
        flight = flown.get(there)
        if there is None or not isinstance(flight, dict):
            continue
        if stood[there].levels != run.levels:
            raise UsageError(f"{folder / there} is at other levels than {run.name} is now; choose another --out")
        told = list(_differences(flight, entry.flight, same_pilot=there == run.name))
        if told:
            another = "; ".join(told[:TOLD])
            raise UsageError(
                f"{folder / there} was begun with another {another}: say the same again, or choose another --out"
            )


def _place(run: StudyRun) -> str:
    levels: dict[str, Level] = dict(sorted(run.levels.items()))
    return json.dumps([run.flight_number, levels])


def _differences(then: dict[str, Any], now: FlightSpec, *, same_pilot: bool) -> Iterator[str]:
    """Yield each value in which a flight differs from one that was kept, with both."""
    left = (*PER_EPISODE, *PER_SITTING, *(() if same_pilot else WHO))
    before, after = dict(_leaves(then, left)), dict(_leaves(json.loads(json.dumps(as_kept(now))), left))
    for name in dict.fromkeys((*before, *after)):
        if before.get(name) != after.get(name) and (same_pilot or name != LOOKING):
            yield f"{name}, {_short(before.get(name))} there and {_short(after.get(name))} now"


def _leaves(value: dict[str, Any], left: tuple[str, ...] = (), path: str = "") -> Iterator[tuple[str, Any]]:
    for name, inner in value.items():
        if name in left and not path:
            continue
        if isinstance(inner, dict) and inner:
            yield from _leaves(inner, (), f"{path}{name}.")
        else:
            yield f"{path}{name}", inner


def _short(value: Any) -> str:
    text = "none" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 40 else f"{text[:40]}…"
