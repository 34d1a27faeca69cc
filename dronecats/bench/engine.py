"""What flies the flights of a campaign: workers on this machine, or whatever else takes flights and gives results."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from dronecats.flight.spec.flight_spec import FlightSpec
from foundation.run_folder.results import Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Sortie:
    """One flight, and where its files go."""

    flight: FlightSpec  # with the record of its episode
    folder: Path  # the episode's, prepared: there, and empty but for empty logs


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed:
    """A flight that is over."""

    sortie: Sortie
    result: Result  # whatever came of it: what the infrastructure broke has the outcome `error`


class Engine(Protocol):
    """Who flies does not decide what: a campaign begins flights, as many at a time as it wants in the air."""

    def begin(self, sortie: Sortie) -> None:
        """Begin a flight. Never waits for one. Raises DronecatsError when nothing can be flown any more."""
        ...

    def landed(self) -> Landed:
        """Wait for the next of the flights that were begun to be over, in whatever order they end, and return it.

        A worker that dies or hangs costs what it had in flight and no more. Raises DronecatsError as `begin`, and lets
        KeyboardInterrupt through.
        """
        ...

    def close(self) -> None:
        """Break off what is in flight, and leave no process behind."""
        ...


class Berths:
    """The workers of one machine, by number, and what each has in flight.

    A worker reads a map once, whoever flies over it then: seconds, and 200 MB. So those of a map go together, as far as
    all workers stay equally busy.
    """

    def __init__(self, jobs: int, workers: int) -> None:
        """`jobs`: flights in the air at a time, and no more than there are; `workers`: at most so many, from 1."""
        self._most = max(1, min(jobs, workers))
        self._room = math.ceil(jobs / self._most)  # of a worker, when all are equally busy
        self._flights: list[set[Path]] = []
        self._maps: list[set[str]] = []

    def take(self, flight: Path, map_name: str) -> int:
        """Return the number of the worker that flies it: with room and its map, else idle or new, else least busy."""
        known = [
            k for k, maps in enumerate(self._maps) if map_name in maps and len(self._flights[k]) < self._room
        ]  # fmt: skip
        if known:
            chosen = min(known, key=self._busy)
        elif len(self._flights) < self._most and all(self._flights):
            chosen = len(self._flights)
            self._flights.append(set())
            self._maps.append(set())
        else:
            chosen = min(range(len(self._flights)), key=self._busy)
        self._flights[chosen].add(flight)
        self._maps[chosen].add(map_name)
        return chosen

    def leave(self, flight: Path) -> None:
        """Say that it is over."""
        for flights in self._flights:
            flights.discard(flight)

    def _busy(self, worker: int) -> int:
        return len(self._flights[worker])
