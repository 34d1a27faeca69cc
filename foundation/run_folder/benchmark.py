"""What a benchmark consists of: bench.json, above the runs that it names."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from msgspec import Meta

from foundation.run_folder.rows import Whole


def _of(description: str) -> Meta:
    return Meta(description=description)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownSuite:
    """The episodes that a run is of."""

    name: Annotated[str | None, _of("null: episodes by name")]
    version: Annotated[Whole, _of("of the records")]
    sha256: Annotated[str, _of("over the ids and digests of its records")]


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkRun:
    """One run of a benchmark: a folder of this name beside bench.json."""

    name: Annotated[str, _of("of its folder: who, agent unless the paper's, command, latency, number of the flight")]
    flight: Annotated[dict[str, Any], _of("each of its flights but for the episode, as in run.json")]
    episodes: Annotated[tuple[str, ...], _of("ids, all that belong to it, whichever of them have been flown")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Benchmark:
    """bench.json: the whole matrix as it was resolved. How much of it one sitting or one machine flies is not in it."""

    schema: Literal[1] = 1
    suite: FlownSuite
    retry: Annotated[bool, _of("whether a flight that did not move is flown once more")]
    runs: tuple[BenchmarkRun, ...]


Level = int | float | str  # of a factor, in its unit; a word of one that has none


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyFactor:
    """What is varied on purpose."""

    name: Annotated[str, _of("of the registry: docs/studies.md")]
    unit: Annotated[str, _of("of its levels; empty: shares, factors and words")]
    levels: Annotated[tuple[Level, ...], _of("that are flown; rising where they are numbers of a range")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRun:
    """One run of a study: a folder of this name beside study.json."""

    name: Annotated[str, _of("of its folder: who, the levels, number of the flight")]
    levels: Annotated[dict[str, Level], _of("by factor, all of them")]
    flight_number: Annotated[Whole, _of("1 is the first; the same number has the same seed at all levels")]


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """study.json: the whole design as it was resolved. How much of it one sitting or one machine flies is not in it."""

    schema: Literal[1] = 1
    name: str
    design: Annotated[str, _of("in words, with what makes it again: generators and resolution, or points and seed")]
    factors: tuple[StudyFactor, ...]
    held: Annotated[dict[str, Level], _of("what is set to one level in every run, by factor")]
    cells: Annotated[tuple[str, ...], _of("of the episodes, in the paper's order")]
    episodes: Annotated[tuple[str, ...], _of("ids, of each run")]
    flights: Annotated[Whole, _of("of each episode by each pilot at each point of the design")]
    seeds: Annotated[
        Literal["paired"], _of("the same episode, flight number and pilot have the same seed at every level")
    ] = "paired"
    runs: tuple[StudyRun, ...]
