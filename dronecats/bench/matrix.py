"""What a benchmark consists of: every pilot under every command and latency, so many flights of each."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args, get_type_hints

from dronecats.agent.latency import LatencyPolicy
from dronecats.agent.names import PAPER
from dronecats.flight.run.identity import suite_digest
from dronecats.flight.spec.flight_spec import FlightSpec
from dronecats.flight.spec.spec_file import as_kept
from episodes.records import catalogue, suites
from episodes.records.record import VERSION, EpisodeRecord
from foundation.errors import UsageError
from foundation.run_folder.benchmark import Benchmark, BenchmarkRun, FlownSuite

COMMANDS: tuple[str, ...] = get_args(get_type_hints(FlightSpec)["command"])
FLIGHTS_MAX = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchEntry:
    """One run: the same flight of each of some episodes."""

    name: str  # of its folder
    flight: FlightSpec  # but for the episode
    episodes: tuple[str, ...]  # ids or files
    beside: str | None = None  # runs that have this in common are flown side by side, episode after episode


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenSuite:
    """Episodes, and what they are together."""

    name: str | None  # None: episodes by name
    records: Mapping[str, EpisodeRecord]  # by id or file, in their order; each of another id
    flown: FlownSuite


def suite_of(episodes: Sequence[str], names: Sequence[str]) -> ChosenSuite:
    """Return the episodes of some suites, or these. Raises UsageError for one that cannot be read, and for none."""
    if episodes and names:
        raise UsageError("choose one: the episodes by name, or --suite")
    chosen = list(dict.fromkeys(episodes))
    for name in () if chosen else names:
        chosen += [each for each in suites.ids(name) if each not in chosen]
    if not chosen:
        raise UsageError("say what is flown: --suite NAME, or episodes by id or file")
    records = {episode: catalogue.load(episode) for episode in chosen}
    times = Counter(record.id for record in records.values())
    for episode, record in records.items():
        if times[record.id] > 1:
            raise UsageError(f"two of the episodes have the id '{record.id}', which each needs to itself")
        if record.id in catalogue.known() and not catalogue.ships(record):
            raise UsageError(f"{episode}: '{record.id}' is the id of an episode that ships; give yours another one")
    versions = {record.version for record in records.values()}
    title = None if episodes else "+".join(names)
    digest = suite_digest((record.id, record.to_json()) for record in records.values())
    return ChosenSuite(
        name=title,
        records=records,
        flown=FlownSuite(name=title, version=max(versions, default=VERSION), sha256=digest),
    )


def part_of(episodes: Sequence[str], limit: int | None = None, shard: tuple[int, int] | None = None) -> tuple[str, ...]:
    """Return the first `limit` of these, and of them the i-th of n parts, (i, n) with 1 ≤ i ≤ n.

    The parts of one list hold each of its episodes once, whichever machine flies which.
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
    """Return every run of the matrix, the first flight of all before the second of any.

    `pilots` are (name, flight but for episode, command and latency). How a fleet is commanded says nothing of one
    drone, so that episodes of one are flown once, under `flat`. The k-th flight differs from the first in its seed
    alone. Raises UsageError for what has two runs of one name, or no run at all.
    """
    if strange := next((each for each in commands if each not in COMMANDS), None):
        raise UsageError(f"--command wants one of {', '.join(COMMANDS)}, got '{strange}'")
    fleets = {each for each, record in suite.records.items() if len(record.starts) > 1}
    alone = suite.records.keys() - fleets
    found: list[BenchEntry] = []
    for number in range(flights):
        for name, base in pilots:
            for command in dict.fromkeys(("flat", *commands)):
                led = replace(base, seed=base.seed + number, **commanded(command))
                flown = (*(alone if command == "flat" else ()), *(fleets if command in commands else ()))
                for latency in latencies if flown else ():
                    flight = replace(led, latency=latency)
                    found.append(
                        BenchEntry(
                            name=f"{slug(name)}{_flown_by(base.agent)}-{command}-{slug(str(latency))}-f{number + 1}",
                            flight=flight,
                            episodes=tuple(each for each in suite.records if each in flown),
                        )
                    )
    times = Counter(entry.name for entry in found)
    if double := next((name for name, count in times.items() if count > 1), None):
        raise UsageError(f"two of the runs would be called {double}; give their pilots other names in the file")
    if not found:
        raise UsageError("nothing is to be flown: name a pilot with --model or --pilot")
    return found


def benchmark(suite: ChosenSuite, runs: Sequence[BenchEntry], *, retry: bool) -> Benchmark:
    """Return what bench.json says of it all."""
    return Benchmark(
        suite=suite.flown,
        retry=retry,
        runs=tuple(
            BenchmarkRun(
                name=entry.name,
                flight=as_kept(entry.flight),
                episodes=tuple(suite.records[each].id for each in entry.episodes),
            )
            for entry in runs
        ),
    )


def slug(text: str) -> str:
    """Return a name as a folder has it."""
    return re.sub(r"[^A-Za-z0-9.]+", "-", text).strip("-.") or "unnamed"


def _flown_by(agent: str) -> str:
    """Return what a folder's name has of an agent: nothing of the paper's."""
    return "" if agent == PAPER else f"-{slug(agent)}"


def commanded(command: str) -> dict[str, Any]:
    """Return the fields of a flight that say how its fleet is commanded; a commander goes with a hierarchy alone."""
    without = {} if command == "hierarchical" else {"commander": None, "scripted": None}
    return {"command": command, **without}
