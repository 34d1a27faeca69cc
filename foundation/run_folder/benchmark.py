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
