"""From the words of `dronecats study`, and a file of the same words, to a study."""

import argparse
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli import bench_spec
from dronecats.cli.options import DISTURBANCES, MODEL, first_set

if TYPE_CHECKING:
    from dronecats.bench.matrix import ChosenSuite
    from dronecats.flight.spec.flight_spec import FlightSpec
    from dronecats.study.design import Axis, Design
    from dronecats.study.plan import StudyPlan
    from foundation.run_folder.benchmark import Level

# what a file says besides the words of a benchmark's file, but for those of that which are factors here
LISTS = ("cells", "maps", "generators")
COUNTS = ("points", "design_seed")
TABLES = ("factors", "held")
OWN = ("name", "seconds", "design", *LISTS, *COUNTS, *TABLES)
WHO = ("pilot", "model")
CHOSEN = ("suite", "cells", "maps")  # how episodes are chosen that are not named
FACTORS_HERE = ("agent", "command", "latency", "rate")
NOT_HERE = (*FACTORS_HERE, "no_retry", "drop_stalled")
DEFAULTS: dict[str, Any] = {"flights": 1, "seed": 0, "parser": "strict", "speed": "max"}


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedStudy:
    """A study as it was asked for."""

    args: argparse.Namespace  # with the file's words where there is one
    out: Path
    suite: "ChosenSuite"
    plan: "StudyPlan"


def of_options(
    args: argparse.Namespace, name: str, factors: Mapping[str, Any], held: Mapping[str, Any] | None = None
) -> AskedStudy:
    """Return the study of every combination of these factors' levels. Raises UsageError."""
    return _asked(args, {"name": name, "factors": factors, "held": held or {}}, Path("runs") / f"study-{name}")


def of_file(args: argparse.Namespace) -> AskedStudy:
    """Return the study of a file, where the command line does not say otherwise.

    Raises UsageError naming the file, the word and what it should be.
    """
    path = args.file
    told = bench_spec.toml(path)
    own = {word.replace("-", "_"): value for word, value in told.items() if word.replace("-", "_") in OWN}
    others = {word: value for word, value in told.items() if word.replace("-", "_") not in OWN}
    known = [word for word in bench_spec.FILE_OPTIONS if word not in NOT_HERE]
    _check_factors_here(path, others)
    for word, value in own.items():
        _check(path, word, value)
    words = bench_spec.checked(path, others, known, OWN)
    words |= {word: own.pop(word) for word in ("cells", "maps", "seconds") if word in own}
    if args.episodes:  # by name, whatever the file chooses; and the other way round
        words = {word: value for word, value in words.items() if word not in CHOSEN}
    if any(getattr(args, word) for word in CHOSEN):
        words.pop("episodes", None)
    bench_spec.filled(args, words)
    return _asked(args, {"name": path.stem, **own}, Path("runs") / path.stem, path)


def _check_factors_here(path: Path, others: Mapping[str, Any]) -> None:
    from foundation.errors import UsageError

    if word := next((each for each in others if each in FACTORS_HERE), None):
        raise UsageError(f"{path}: {word} is a factor: say it under [factors], or under [held] where it is one level")


def _check(path: Path, word: str, value: Any) -> None:
    """Raise UsageError unless a file's word of our own is of its kind."""
    from dronecats.study.design import KINDS
    from foundation.errors import UsageError

    def wants(what: str) -> UsageError:
        return UsageError(f"{path}: {word} wants {what}, got {value!r:.60}")

    if word in LISTS and not (isinstance(value, list) and value and all(isinstance(one, str) for one in value)):
        raise wants("a list of words")
    if word in COUNTS and (not isinstance(value, int) or isinstance(value, bool) or value < 0):
        raise wants("a whole number")
    if word in TABLES and not isinstance(value, dict):
        raise wants("a table")
    if word == "name" and not (isinstance(value, str) and value):
        raise wants("a word")
    if word == "seconds" and (not isinstance(value, int | float) or isinstance(value, bool)):
        raise wants("a number")
    if word == "design" and value not in KINDS:
        raise wants(f"one of {', '.join(KINDS)}")


@contextmanager
def _naming(file: Path | None) -> Iterator[None]:
    """Name a file in what is raised within, where there is one."""
    from foundation.errors import UsageError

    try:
        yield
    except UsageError as wrong:
        raise UsageError(f"{file}: {wrong}" if file else str(wrong)) from None


def _asked(args: argparse.Namespace, told: Mapping[str, Any], folder: Path, file: Path | None = None) -> AskedStudy:
    from dronecats.study.plan import check_flights, plan

    args = bench_spec.filled(args, DEFAULTS)
    suite = suite_of_options(args)
    out = args.out or folder
    with _naming(file):
        varied, once = (_from_file(told.get(table, {}), file) for table in TABLES)
        axes = [_axis(name, value) for name, value in varied.items()]
        _check_once("[factors]", varied)
        design = _design(axes, told)
        held = _held("[held]", once.items())
    held |= _held("--hold", [_pair(each) for each in args.hold or ()])
    pilots = _pilots(args, out, {**{axis.name: axis.ends for axis in axes}, **{k: (v,) for k, v in held.items()}})
    with _naming(file):
        resolved = plan(told["name"], pilots, suite, design, held=held, flights=args.flights)
        check_flights(resolved)
    return AskedStudy(args=args, out=out, suite=suite, plan=resolved)


def _from_file(factors: Mapping[str, Any], file: Path | None) -> dict[str, Any]:
    """Return a table of a file with the recorded latencies in it looked for from the file's own folder."""
    from dronecats.flight.spec.latency_trace import from_folder
    from dronecats.study.factors import POLICY

    def placed(level: Any) -> Any:
        return from_folder(level, file.parent) if file and isinstance(level, str) else level

    return {
        name: value
        if name.replace("-", "_") != POLICY
        else [placed(level) for level in value]
        if isinstance(value, list)
        else placed(value)
        for name, value in factors.items()
    }


def suite_of_options(args: argparse.Namespace) -> "ChosenSuite":
    """Return the episodes: by name, or a suite's of these cells and maps."""
    from dronecats.bench.matrix import suite_of
    from episodes.records import catalogue, suites
    from episodes.records.record import CELLS
    from foundation.errors import UsageError

    if not (args.cells or args.maps):
        return bench_spec.suite(args)
    if args.episodes:
        raise UsageError("--cells and --maps choose from a suite; leave them out, or the episodes by name")
    names = args.suite or ["all"]
    records = [catalogue.load(each) for each in dict.fromkeys(each for name in names for each in suites.ids(name))]
    cells = _known("--cells", args.cells or CELLS, CELLS)
    maps = _known("--maps", args.maps or (), sorted({record.map for record in records}))
    kept = [each.id for each in records if each.cell in cells and (not maps or each.map in maps)]
    if not kept:
        raise UsageError(f"no episode of {'+'.join(names)} is {', '.join(cells)} on {', '.join(maps) or 'any map'}")
    return suite_of(kept, ())


def _known(option: str, asked: Iterable[str], known: Iterable[str]) -> list[str]:
    from foundation.errors import UsageError

    known = list(known)
    if strange := next((each for each in asked if each not in known), None):
        raise UsageError(f"{option} wants some of {', '.join(known)}, got '{strange:.60}'")
    return list(dict.fromkeys(asked))


def _pair(word: str) -> tuple[str, str]:
    from foundation.errors import UsageError

    name, equals, level = word.partition("=")
    if not equals:
        raise UsageError(f"--hold wants FACTOR=LEVEL, for example wind=6, got '{word:.60}'")
    return name.strip(), level.strip()


def _held(where: str, told: Iterable[tuple[str, Any]]) -> "dict[str, Level]":
    from dronecats.study.factors import factor_of

    pairs = list(told)
    _check_once(where, [name for name, _ in pairs])
    return {factor_of(name).name: factor_of(name).level(value) for name, value in pairs}


def _check_once(where: str, names: Iterable[str]) -> None:
    """Raise UsageError where a factor is named twice, once as `link-loss` and once as `link_loss` for example."""
    from dronecats.study.factors import factor_of
    from foundation.errors import UsageError

    found = [factor_of(name).name for name in names]
    if twice := next((name for name in found if found.count(name) > 1), None):
        raise UsageError(f"{where} says {twice} twice; leave one of them out")


def _axis(name: str, value: Any) -> "Axis":
    """Return what is flown of a factor: a list of levels, or a table of low and high."""
    from dronecats.study.design import Axis
    from dronecats.study.factors import factor_of
    from foundation.errors import UsageError

    factor = factor_of(name)
    if isinstance(value, list) and value:
        levels = tuple(factor.level(each) for each in value)
        if len(set(levels)) < len(levels):
            raise UsageError(f"{factor.name} has one of its levels twice")
        return Axis(name=factor.name, levels=levels)
    if isinstance(value, dict) and set(value) == {"low", "high"} and factor.quantity:
        low, high = (float(factor.level(value[end])) for end in ("low", "high"))
        if low >= high:
            raise UsageError(f"{factor.name} wants a low that is below its high, got {low:g} and {high:g}")
        return Axis(name=factor.name, low=low, high=high, whole=factor.quantity.whole)
    ranges = ", or { low = …, high = … }" if factor.quantity else ""
    raise UsageError(f"{factor.name} wants a list of levels{ranges}, got {value!r:.60}; one level goes under held")


def _design(axes: "list[Axis]", told: Mapping[str, Any]) -> "Design":
    from dronecats.study import design
    from dronecats.study.factors import WHO_FLIES
    from foundation.errors import UsageError

    kind = told.get("design", "full")
    for word, of in (("generators", "fractional"), ("points", "latin"), ("design_seed", "latin")):
        if word in told and kind != of:
            raise UsageError(f'{word} goes with design = "{of}"; leave it out')
    if not axes:
        raise UsageError("a study wants factors: say what is varied under [factors], as in docs/studies.md")
    if kind == "fractional":
        return design.fractional(axes, told.get("generators", ()))
    if kind == "latin":
        if "points" not in told:
            raise UsageError('design = "latin" wants points = N')
        return design.latin(axes, told["points"], told.get("design_seed", 0))
    return design.one_at_a_time(axes, WHO_FLIES) if kind == "one-at-a-time" else design.full(axes)


def _pilots(
    args: argparse.Namespace, out: Path, levels: "Mapping[str, tuple[Level, ...]]"
) -> "list[tuple[str, FlightSpec]]":
    """Return who flies, but for what `levels` of factors say: where that is the pilot itself, one without a name."""
    from dronecats.agent.latency import LatencyPolicy
    from dronecats.flight.spec.flight_spec import LATENCY
    from foundation.errors import UsageError
    from foundation.protocol import CAP_S

    if both := first_set(args, (option for option in DISTURBANCES if option.name in levels)):
        raise UsageError(f"{both.flag} is one of the factors, or held; leave one of them out")
    who = next((name for name in WHO if name in levels), None)
    if who and (args.pilot or args.model):
        raise UsageError(f"{who} is one of the factors; leave --{'pilot' if args.pilot else 'model'} out")
    if who and (option := first_set(args, MODEL)):
        raise UsageError(
            f"{option.flag} is of one --model, and {who} is one of the factors, or held; leave it out:"
            " a row of models.toml has its own"
        )
    if who == "pilot" and args.rendered:
        raise UsageError("--rendered goes with --pilot: of pilots that are a factor, those that look have pictures")
    args.agent, args.command = None, list(levels.get("command", ()))
    if who:
        setattr(args, who, [levels[who][0]])
    latency = LatencyPolicy.parse(LATENCY if args.speed == "max" else "real")
    seconds = CAP_S if args.seconds is None else float(args.seconds)
    return [
        ("" if who else name, replace(flight, latency=latency, seconds=seconds))
        for name, flight in bench_spec.pilots(args, out)
    ]
