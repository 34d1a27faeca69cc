"""How scores scatter from flight to flight, beside what chance alone would do. Paper, "Score variance"."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Spread:
    """Successes of several flights over the same episodes."""

    totals: tuple[int, ...]  # successes of each flight
    episodes: int  # of each
    mean: float  # successes
    deviation: float | None  # successes, standard deviation over the flights; None: of one flight
    low: float | None  # interval of the deviation, were the totals normal, of what the deviation can be
    high: float | None
    binomial: float  # successes, expected of that many coins of the same share: the paper's sqrt(n p (1 - p))
    by_episode: float | None  # expected where each episode has a share of its own, as a hard and an easy one have


def spread(flights: Sequence[Sequence[bool]], confidence: float = 0.95) -> Spread:
    """Return how flights scatter; each holds the successes of the same episodes in the same order.

    Raises ValueError when there is no flight, or they are of different lengths.
    """
    if not flights or not flights[0] or len({len(each) for each in flights}) > 1:
        raise ValueError("a spread wants flights of the same episodes, at least one of each")
    totals, episodes = tuple(map(sum, flights)), len(flights[0])
    mean = statistics.fmean(totals)
    deviation = statistics.stdev(totals) if len(totals) > 1 else None
    low, high = (None, None) if deviation is None else deviation_interval(deviation, len(totals), confidence)
    if high is not None and deviation is not None:  # no deviation of totals from 0 to all is larger than half of all
        high = max(deviation, min(high, episodes / 2))
    return Spread(
        totals=totals,
        episodes=episodes,
        mean=mean,
        deviation=deviation,
        low=low,
        high=high,
        binomial=binomial_deviation(mean / episodes, episodes),
        by_episode=_by_episode(flights) if len(flights) > 1 else None,
    )


def binomial_deviation(share: float, trials: int) -> float:
    """Return the standard deviation of the successes of independent trials of one share."""
    return math.sqrt(trials * share * (1.0 - share))


def deviation_interval(deviation: float, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the interval of a standard deviation that `count` normal values gave (by chi-square)."""
    from scipy.special import chdtri  # a base dependency, but slow to import for whoever needs it not

    freedom, tail = count - 1, (1 - confidence) / 2
    square = freedom * deviation * deviation
    return math.sqrt(square / chdtri(freedom, tail)), math.sqrt(square / chdtri(freedom, 1 - tail))


def _by_episode(flights: Sequence[Sequence[bool]]) -> float:
    """Return the deviation of totals were flights independent: each episode's own variance (unbiased) added up."""
    each = zip(*flights, strict=True)
    return math.sqrt(sum(statistics.variance(map(float, outcomes)) for outcomes in each))
