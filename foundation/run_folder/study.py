"""What a study consists of: study.json, beside the bench.json of its runs."""

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from foundation.run_folder.rows import Whole

Level = int | float | str  # of a factor, in its unit; a word of one that has none


def _of(description: str) -> Meta:
    return Meta(description=description)


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
