"""How the draws of a request are spread: evenly over what is allowed, each dimension dealt out on its own."""

import random
from dataclasses import dataclass

JITTER = 0.25  # of a stratum, either way


@dataclass(frozen=True, slots=True)
class Draw:
    """Where one record's draw lies between the least and the most that is allowed, each 0 … 1."""

    turn: float  # of the yaws that show the target whole, or of those that hide it
    distance: float  # of the start distances
    height: float  # of the start heights


def shares(count: int, rng: random.Random) -> list[Draw]:
    """Return the shares of so many records: each dimension cut into as many strata, and each stratum drawn once.

    Where there are many records the first and the last stratum lie at the ends, so that the whole range is used.
    """
    turns, distances, heights = (_strata(count, rng) for _ in range(3))
    return [Draw(*three) for three in zip(turns, distances, heights, strict=True)]


def _strata(count: int, rng: random.Random) -> list[float]:
    if count == 1:
        return [rng.random()]
    drawn = [(k + rng.uniform(-JITTER, JITTER)) / (count - 1) for k in range(count)]
    rng.shuffle(drawn)
    return [min(max(one, 0.0), 1.0) for one in drawn]
