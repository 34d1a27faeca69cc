"""Which of some workers flies which flight."""

import math
from pathlib import Path


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
