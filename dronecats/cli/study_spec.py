"""Converts the options of `dronecats study`, or a study file, into a study."""

import argparse
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.models.spec import Text
from dronecats.bench.matrix import ChosenSuite, choose_suite
from dronecats.cli import bench_spec
from dronecats.cli.bench_spec import FILE_OPTIONS
from dronecats.cli.options import DISTURBANCES, MODEL, first_set
from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec, from_folder
from dronecats.study import design
from dronecats.study.design import Axis, Design
from dronecats.study.factors import ENTRANT_FACTORS, POLICY, factor_of
from dronecats.study.plan import StudyPlan, check_flights, plan
from episodes.records import catalogue
from episodes.records.record import CELLS
from foundation.errors import UsageError
from foundation.protocol import CAP_S
from foundation.run_folder.results import Level
from foundation.typed_file import no_choice, toml_table, typed
from foundation.wording import did_you_mean, nearest

_Words = Annotated[tuple[str, ...], Meta(min_length=1)]
_Count = Annotated[int, Meta(ge=0)]
OWN_KEYS: dict[str, Any] = {  # keys of a study file that a benchmark file does not have
    "name": Text,
    "seconds": float,
    "design": str,
    "cells": _Words,
    "maps": _Words,
    "generators": _Words,
    "points": _Count,
    "design_seed": _Count,
    "factors": dict[str, Any],
    "held": dict[str, Any],
}
PILOT_FACTORS = ("pilot", "model")
FACTOR_KEYS = ("agent", "command", "latency", "rate")  # keys of a benchmark file that are factors in a study
BENCH_KEYS = [key for key in FILE_OPTIONS if key not in (*FACTOR_KEYS, "no_retry", "drop_stalled")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRequest:
    """A study as the user requested it."""

    args: argparse.Namespace  # options, completed by the values of the study file if there is one
    out: Path
    suite: ChosenSuite
    plan: StudyPlan


def of_options(
    args: argparse.Namespace, name: str, factors: Mapping[str, Any], held: Mapping[str, Any] | None = None
) -> StudyRequest:
    """Return the study of every combination of these factors' levels. Raises UsageError."""
    return _request(args, {"name": name, "factors": factors, "held": held or {}}, Path("runs") / f"study-{name}")


def of_file(args: argparse.Namespace) -> StudyRequest:
    """Return the study in a file. Options on the command line override the file.

    Raises UsageError, which names the file, the key and the wanted value.
    """
    path = args.file
    table = toml_table(path, str(path))
    keys = {key: key.replace("-", "_") for key in table}
    own = {key: typed(table[k], OWN_KEYS[key], str(path), key) for k, key in keys.items() if key in OWN_KEYS}
    of_bench = {key: value for key, value in table.items() if keys[key] not in OWN_KEYS}
    if factor := next((key for key in of_bench if key in FACTOR_KEYS), None):
        raise UsageError(
            f"{path}: {factor} is a factor. Put its levels under [factors], or a single level under [held]"
        )
    values = bench_spec.checked(path, of_bench, BENCH_KEYS, tuple(OWN_KEYS))
    values |= {key: own.pop(key) for key in ("cells", "maps", "seconds") if key in own}
    bench_spec.filled(args, values)
    return _request(args, {"name": path.stem, **own}, Path("runs") / path.stem, path)


@contextmanager
def _naming(file: Path | None) -> Iterator[None]:
    """Prefix any UsageError raised in the block with the file's name, if there is a file."""
    try:
        yield
    except UsageError as error:
        raise UsageError(f"{file}: {error}" if file else str(error)) from None


def _request(
    args: argparse.Namespace, study: Mapping[str, Any], folder: Path, file: Path | None = None
) -> StudyRequest:
    args = bench_spec.filled(args, bench_spec.DEFAULTS)
    suite = suite_of_options(args)
    out = args.out or folder
    with _naming(file):
        varied, single = (_from_file(study.get(table, {}), file) for table in ("factors", "held"))
        axes = [_axis(name, value) for name, value in varied.items()]
        _check_once("[factors]", varied)
        chosen = _design(axes, study)
        held = _held("[held]", single.items())
    held |= _held("--hold", [_pair(text) for text in args.hold or ()])
    pilots = _pilots(args, out, {**{axis.name: axis.ends for axis in axes}, **{k: (v,) for k, v in held.items()}})
    with _naming(file):
        resolved = plan(study["name"], pilots, suite, chosen, held=held, flights=args.flights)
        check_flights(resolved)
    return StudyRequest(args=args, out=out, suite=suite, plan=resolved)


def _from_file(factors: Mapping[str, Any], file: Path | None) -> dict[str, Any]:
    """Return a table of a study file. Resolves paths of recorded latencies against the file's folder."""

    def placed(value: Any) -> Any:
        if isinstance(value, list):
            return [placed(level) for level in value]
        return from_folder(value, file.parent) if file and isinstance(value, str) else value

    return {name: placed(value) if name.replace("-", "_") == POLICY else value for name, value in factors.items()}


def suite_of_options(args: argparse.Namespace) -> ChosenSuite:
    """Return the episodes that are named, or the episodes of a suite with the given cells and maps."""
    if not (args.cells or args.maps):
        return bench_spec.suite(args)
    if args.episodes:
        raise UsageError("--cells and --maps choose from a suite. Leave them out, or leave the named episodes out")
    names = args.suite or ["all"]
    records = [catalogue.load(id) for id in dict.fromkeys(id for name in names for id in catalogue.suite_ids(name))]
    cells = _valid("--cells", args.cells or CELLS, CELLS)
    maps = _valid("--maps", args.maps or (), sorted({record.map for record in records}))
    kept = [record.id for record in records if record.cell in cells and (not maps or record.map in maps)]
    if not kept:
        raise UsageError(
            f"no episode of the suite {'+'.join(names)} is {', '.join(cells)} on {', '.join(maps) or 'any map'}"
        )
    return choose_suite(kept, ())


def _valid(option: str, names: Iterable[str], choices: Iterable[str]) -> list[str]:
    """Return the names without duplicates. Raises UsageError for a name that is not among the choices."""
    choices = list(choices)
    if unknown := next((name for name in names if name not in choices), None):
        near = nearest(unknown, choices)
        hint = f": {did_you_mean(near)}" if near else ""
        raise UsageError(f"{option} must be some of {', '.join(choices)}; got '{unknown:.60}'{hint}")
    return list(dict.fromkeys(names))


def _pair(word: str) -> tuple[str, str]:
    name, equals, level = word.partition("=")
    if not equals:
        raise UsageError(f"--hold must be FACTOR=LEVEL, for example wind=6; got '{word:.60}'")
    return name.strip(), level.strip()


def _held(where: str, levels: Iterable[tuple[str, Any]]) -> dict[str, Level]:
    pairs = list(levels)
    _check_once(where, [name for name, _ in pairs])
    return {factor_of(name).name: factor_of(name).level(value) for name, value in pairs}


def _check_once(where: str, names: Iterable[str]) -> None:
    """Raise UsageError if a factor is named twice, for example as `link-loss` and as `link_loss`."""
    factors = [factor_of(name).name for name in names]
    if twice := next((name for name in factors if factors.count(name) > 1), None):
        raise UsageError(f"{where} sets {twice} twice. Leave one of them out")


def _axis(name: str, value: Any) -> Axis:
    """Return the axis of a factor from a list of levels, or from a table of low and high."""
    factor = factor_of(name)
    if isinstance(value, list) and value:
        levels = tuple(factor.level(level) for level in value)
        if len(set(levels)) < len(levels):
            raise UsageError(f"{factor.name} has a level twice. Remove one")
        return Axis(name=factor.name, levels=levels)
    if isinstance(value, dict) and set(value) == {"low", "high"} and factor.quantity:
        low, high = (float(factor.level(value[end])) for end in ("low", "high"))
        if low >= high:
            raise UsageError(f"{factor.name} needs low < high, got {low:g} and {high:g}")
        return Axis(name=factor.name, low=low, high=high, integer=factor.quantity.whole)
    ranges = ", or { low = …, high = … }" if factor.quantity else ""
    raise UsageError(
        f"{factor.name} must be a list of levels{ranges}; got {value!r:.60}. Put a single level under [held]"
    )


def _design(axes: list[Axis], study: Mapping[str, Any]) -> Design:
    kind = study.get("design", "full")
    if kind not in design.KINDS:
        raise UsageError(f"'design' {no_choice(kind, design.KINDS)}")
    for key, of in (("generators", "fractional"), ("points", "latin"), ("design_seed", "latin")):
        if key in study and kind != of:
            raise UsageError(f'{key} goes with design = "{of}". Leave it out')
    if not axes:
        raise UsageError("the study has no factors. List what varies under [factors], as in docs/studies.md")
    if kind == "fractional":
        return design.fractional(axes, study.get("generators", ()))
    if kind == "latin":
        if "points" not in study:
            raise UsageError('design = "latin" needs points = N')
        return design.latin(axes, study["points"], study.get("design_seed", 0))
    return design.one_at_a_time(axes, ENTRANT_FACTORS) if kind == "one-at-a-time" else design.full(axes)


def _pilots(
    args: argparse.Namespace, out: Path, levels: Mapping[str, tuple[Level, ...]]
) -> list[tuple[str, FlightSpec]]:
    """Return the name and the flight specification of each pilot. If the pilot is a factor: one entry without a name.

    `levels`: the levels of each varied or held factor, by the factor's name.
    """
    if option := first_set(args, (option for option in DISTURBANCES if option.name in levels)):
        raise UsageError(f"{option.flag} is also a factor, or held. Leave one of them out")
    factor = next((name for name in PILOT_FACTORS if name in levels), None)
    if factor and (args.pilot or args.model):
        raise UsageError(f"{factor} is a factor. Leave --{'pilot' if args.pilot else 'model'} out")
    if factor and (option := first_set(args, MODEL)):
        raise UsageError(
            f"{option.flag} goes with one --model, and {factor} is a factor, or held. Leave it out:"
            " a row of models.toml has its own"
        )
    if factor == "pilot" and args.rendered:
        raise UsageError(
            "--rendered goes with --pilot: if the pilot is a factor, each pilot decides whether frames are rendered"
        )
    args.agent, args.command = None, list(levels.get("command", ()))
    if factor:
        setattr(args, factor, [levels[factor][0]])
    latency = LatencyPolicy.parse(LATENCY if args.speed == "max" else "real")
    seconds = CAP_S if args.seconds is None else float(args.seconds)
    return [
        ("" if factor else name, replace(flight, latency=latency, seconds=seconds))
        for name, flight in bench_spec.pilots(args, out, levels)
    ]
