"""Turns the options of `dronecats bench`, and a file of the same options, into the runs of a benchmark."""

import argparse
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.names import PAPER
from dronecats.bench.matrix import BenchEntry, ChosenSuite, choose_suite, entries
from dronecats.cli.fly_spec import commanded_by, template_of
from dronecats.cli.options import (
    DISTURBANCES,
    DROP_STALLED,
    MATRIX,
    MODEL,
    NO_RETRY,
    PILOTS,
    PLACE,
    SELECTION,
    Option,
    accounts_of,
    first_set,
    is_set,
    model_of,
    speed,
)
from dronecats.flight.spec.disturbances import UNDISTURBED
from dronecats.flight.spec.flight_spec import LATENCY, FlightSpec, Simulated, from_folder, latency_policy
from dronecats.pilots import roster
from foundation.errors import UsageError
from foundation.run_folder.layout import LEDGER
from foundation.typed_file import toml_table
from foundation.wording import did_you_mean, nearest

EPISODES = Option(name="episodes", many=True, help="by id or file")
# the valid keys of a benchmark file
FILE_OPTIONS = {
    option.name: option
    for option in (EPISODES, *SELECTION, *PILOTS, *MATRIX, NO_RETRY, *DISTURBANCES, *PLACE, DROP_STALLED)
}
# valid keys of a model that is a table in a file; `reasoning` is a short name of reasoning_effort
ROW = ("name", "called", "reasoning", *(option.name for option in MODEL))
# option → options that set the same value in another way
ALTERNATIVES = {
    "episodes": ("suite", "cells", "maps"), "suite": ("episodes",), "cells": ("episodes",), "maps": ("episodes",),
    "latency": ("rate",), "rate": ("latency",),
}  # fmt: skip
DEFAULTS: dict[str, Any] = {"flights": 1, "seed": 0, "parser": "strict", "speed": "max"}
MOST = {"flights": 1000, "jobs": 1024, "limit": 1_000_000}  # largest valid value of each option


def with_file(args: argparse.Namespace) -> argparse.Namespace:
    """Return the arguments. An absent option gets its value from the .toml file among the episodes, else its default.

    Raises UsageError for a file that cannot be read or has an unknown key.
    """
    files = [Path(name) for name in args.episodes if name.endswith(".toml")]
    values: dict[str, Any] = {}
    if files:
        if len(args.episodes) > 1:
            raise UsageError("a .toml file cannot be combined with other episodes. Name them in the file")
        values = checked(files[0], toml_table(files[0], str(files[0])), tuple(FILE_OPTIONS))
        args.episodes = []
        values.setdefault("out", str(Path("runs") / files[0].stem))
    return filled(args, {**DEFAULTS, **values})


def filled(args: argparse.Namespace, values: dict[str, Any]) -> argparse.Namespace:
    """Return the arguments. An absent option gets its value from `values`, unless one of its ALTERNATIVES was given.

    Raises UsageError for an invalid count.
    """
    given = {name for name, value in vars(args).items() if is_set(value)}
    for name, value in values.items():
        if name not in given and given.isdisjoint(ALTERNATIVES.get(name, ())):
            is_path = name in FILE_OPTIONS and FILE_OPTIONS[name].kind is Path
            setattr(args, name, Path(value) if is_path else value)
    for name, most in MOST.items():
        value = getattr(args, name)
        if value is not None and not 1 <= value <= most:
            raise UsageError(f"--{name} must be 1 to {most}, got {value}")
    return args


def checked(path: Path, table: dict[str, Any], names: Sequence[str], more_names: Sequence[str] = ()) -> dict[str, Any]:
    """Return the values of a file by option. `names` are the valid keys.

    Raises UsageError for an invalid value, and for an unknown key. The error then suggests a similar key of `names` or
    `more_names`.
    """
    values: dict[str, Any] = {}
    for key, value in table.items():
        name = key.replace("-", "_")
        if name not in names:
            near = nearest(name, (*names, *more_names), count=1)
            raise UsageError(f"{path}: '{key}' is not known{f': {did_you_mean(near)}' if near else ''}")
        values[name] = _checked(path, name, value)
    return values


def _checked(path: Path, name: str, value: Any) -> Any:
    try:
        checked = FILE_OPTIONS[name].read(value)
    except ValueError as wanted:
        raise UsageError(f"{path}: {name} must be {wanted}, got {value!r:.60}") from None
    return [from_folder(policy, path.parent) for policy in checked] if name == "latency" else checked


def suite(args: argparse.Namespace) -> ChosenSuite:
    """Return the requested episodes. Raises UsageError."""
    return choose_suite(args.episodes or (), args.suite or ())


def runs(args: argparse.Namespace, chosen: ChosenSuite, out: Path) -> list[BenchEntry]:
    """Return all runs of the benchmark. `out`: its folder. Raises UsageError."""
    return entries(
        pilots(args, out), chosen, commands=args.command or ("flat",), latencies=_latencies(args), flights=args.flights
    )


def shard(args: argparse.Namespace) -> tuple[int, int] | None:
    """Return (i, n) of --shard i/n; None without --shard. Raises UsageError."""
    if args.shard is None:
        return None
    index, _, count = args.shard.partition("/")
    if not (index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count) <= 10_000):
        raise UsageError(f"--shard must be i/n with i from 1 to n, got '{args.shard}'")
    return int(index), int(count)


def _latencies(args: argparse.Namespace) -> list[LatencyPolicy]:
    """Return the latency policies: those of --latency, or one per value of --rate, or the default."""
    if args.rate and args.latency:
        raise UsageError("--rate and --latency both set the time of a reply. Leave one of them out")
    if args.rate:
        return [latency_policy(f"rate:{rate}") for rate in args.rate]
    return [latency_policy(text) for text in args.latency or [LATENCY if args.speed == "max" else "real"]]


def pilots(args: argparse.Namespace, out: Path, varied: Collection[str] = ()) -> list[tuple[str, FlightSpec]]:
    """Return (name, flight) for each pair of pilot and agent. The flights have no episode, command or latency yet.

    `varied`: names of the factors that a study sets afterwards.
    """
    named: list[tuple[str, dict[str, Any]]] = [_model(row, args) for row in args.model or ()]
    named += [(name, {"pilot": roster.check(name)}) for name in args.pilot or ()]
    if not args.model and (alone := first_set(args, MODEL)):
        raise UsageError(f"{alone.flag} goes with --model PROVIDER/NAME")
    commanders = argparse.Namespace(command="hierarchical", commander=args.commander, commander_url=args.commander_url)
    commanded = commanded_by(commanders) if args.commander else {}
    if args.commander and "hierarchical" not in (args.command or ()):
        raise UsageError(
            "--commander goes with --command hierarchical (in a study --hold command=hierarchical). Add it, or"
            " leave --commander out"
        )
    accounts = accounts_of(args, out / LEDGER)
    factor = speed(args.speed)
    flights = []
    for name, pilot in named:
        pays = "model" in pilot or "commander" in commanded
        looks = "model" in pilot or roster.needs_pictures(pilot["pilot"]) or "commander" in commanded
        flight = FlightSpec(
            **pilot,
            **commanded,
            simulated=Simulated(speed=factor, rendered=args.rendered or looks or factor is not None),
            accounts=accounts if pays else replace(accounts, ledger=None),
            prompt=template_of(args.prompt) if args.prompt else None,
            parser=args.parser,
            stop_unreadable=args.stop_unreadable,
            disturbances=UNDISTURBED.with_options(vars(args), varied),
            seed=args.seed,
            full=args.full,
        )
        flights += [(name, replace(flight, agent=agent)) for agent in dict.fromkeys(args.agent or (PAPER,))]
    return flights


def _model(row: Any, args: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """Return a model's name for folders, and the field of `FlightSpec` with the model.

    `row`: PROVIDER/NAME, or the model's table in a file.
    """
    if isinstance(row, str):
        model = model_of(row, args)
        return model.title, {"model": model}
    if stray := next((key for key in row if key not in ROW), None):
        raise UsageError(f"a model of the file has the unknown key '{stray}'. Known keys are {', '.join(ROW)}")
    if not isinstance(row.get("name"), str):
        raise UsageError('a model of the file that is a table needs a name = "PROVIDER/NAME"')
    values = {option.name: getattr(args, option.name) for option in MODEL}
    own = {name: str(row[name]) for name in values if name in row}
    if "reasoning" in row:
        own["reasoning_effort"] = str(row["reasoning"])
    for option in MODEL:
        if option.choices and own.get(option.name, option.choices[0]) not in option.choices:
            wanted = f"must be one of {', '.join(option.choices)}, got '{own[option.name]}'"
            raise UsageError(f"{option.name} of {row['name']} {wanted}")
    model = model_of(row["name"], argparse.Namespace(**{**values, **own}))
    return str(row.get("called", model.title)), {"model": model}
