"""Chooses the suite of a benchmark, and lists its runs: all combinations of pilot, command (of fleets) and latency."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args, get_type_hints

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.names import PAPER
from dronecats.flight.run.identity import suite_digest
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_redacted_json
from episodes.records import catalogue
from episodes.records.record import EpisodeRecord
from foundation.errors import UsageError
from foundation.run_folder.results import Benchmark, BenchmarkRun, FlownSuite

COMMANDS: tuple[str, ...] = get_args(get_type_hints(FlightSpec)["command"])


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchEntry:
    """One run: one flight of each episode in `episodes`, all with the same settings."""

    name: str  # name of the run's folder
    flight: FlightSpec  # settings of the run, without the episode
    episodes: tuple[str, ...]  # ids or files
    beside: str | None = None  # runs with the same value are interleaved, episode after episode


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSuite:
    """The episodes of a benchmark, and the suite that they form."""

    records: Mapping[str, EpisodeRecord]  # id or file, as given → record; all ids differ
    identity: FlownSuite


def choose_suite(episodes: Sequence[str], names: Sequence[str]) -> ChosenSuite:
    """Return `episodes`, or the episodes of the suites `names`.

    Raises UsageError if both are given, if there is no episode, and for an invalid episode.
    """
    if episodes and names:
        raise UsageError("choose episodes by name or with --suite, not both")
    chosen = list(dict.fromkeys(episodes))
    for name in () if chosen else names:
        chosen += [episode for episode in catalogue.suite_ids(name) if episode not in chosen]
    if not chosen:
        raise UsageError("no episodes were named. Add --suite NAME, or episodes by id or file")
    records = {episode: catalogue.load(episode) for episode in chosen}
    times = Counter(record.id for record in records.values())
    for episode, record in records.items():
        if times[record.id] > 1:
            raise UsageError(f"two episodes have the id '{record.id}'. Give each its own id")
        if record.id in catalogue.all_ids() and not catalogue.is_shipped(record):
            raise UsageError(f"{episode}: '{record.id}' is the id of a shipped episode. Choose another id")
    title = None if episodes else "+".join(names)
    digest = suite_digest((record.id, record.to_json()) for record in records.values())
    return ChosenSuite(records=records, identity=FlownSuite(name=title, version=catalogue.VERSION, sha256=digest))


def part_of(episodes: Sequence[str], limit: int | None = None, shard: tuple[int, int] | None = None) -> tuple[str, ...]:
    """Return shard i of n of the first `limit` episodes; `shard` is (i, n) with 1 ≤ i ≤ n.

    Each episode is in exactly one shard.
    """
    first = tuple(episodes[:limit])
    return first if shard is None else first[shard[0] - 1 :: shard[1]]


def entries(
    pilots: Sequence[tuple[str, FlightSpec]],
    suite: ChosenSuite,
    *,
    commands: Sequence[str] = ("flat",),
    latencies: Sequence[LatencyPolicy],
    flights: int = 1,
) -> list[BenchEntry]:
    """Return all runs of the matrix: the first flights of all combinations, then the second flights, and so on.

    `pilots`: (name, flight); the flight has no episode, command or latency yet. `commands` are for fleets; one drone
    always flies with `flat`. The k-th flight differs from the first only in its seed. Raises UsageError for an unknown
    command, for two runs with the same name, and if there is no run.
    """
    if unknown := next((command for command in commands if command not in COMMANDS), None):
        raise UsageError(f"--command must be one of {', '.join(COMMANDS)}, got '{unknown}'")
    fleets = {episode for episode, record in suite.records.items() if len(record.starts) > 1}
    single = suite.records.keys() - fleets
    runs: list[BenchEntry] = []
    for number in range(flights):
        for name, base in pilots:
            for command in dict.fromkeys(("flat", *commands)):
                flight = replace(
                    base, seed=base.seed + number, **command_fields(command)
                )  # raises UsageError if this command does not fit the flight
                selected = {*(single if command == "flat" else ()), *(fleets if command in commands else ())}
                agent = "" if base.agent == PAPER else f"-{slug(base.agent)}"
                for latency in latencies if selected else ():
                    runs.append(
                        BenchEntry(
                            name=f"{slug(name)}{agent}-{command}-{slug(str(latency))}-f{number + 1}",
                            flight=replace(flight, latency=latency),
                            episodes=tuple(episode for episode in suite.records if episode in selected),
                        )
                    )
    times = Counter(entry.name for entry in runs)
    if double := next((name for name, count in times.items() if count > 1), None):
        raise UsageError(f"two runs have the name {double}. Give their pilots other names in the file")
    if not runs:
        raise UsageError("no pilot was named. Add --model or --pilot")
    return runs


def benchmark(suite: ChosenSuite, runs: Sequence[BenchEntry], *, retry: bool) -> Benchmark:
    """Return the contents of bench.json."""
    return Benchmark(
        suite=suite.identity,
        retry=retry,
        runs=tuple(
            BenchmarkRun(
                name=entry.name,
                flight=as_redacted_json(entry.flight),
                episodes=tuple(suite.records[episode].id for episode in entry.episodes),
            )
            for entry in runs
        ),
    )


def slug(text: str) -> str:
    """Return the text with only the characters that folder names allow."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", text).strip("-.") or "unnamed"


def command_fields(command: str) -> dict[str, Any]:
    """Return the fields of a flight for a command. Only `hierarchical` keeps the commander."""
    without = {} if command == "hierarchical" else {"commander": None, "scripted": None}
    return {"command": command, **without}
