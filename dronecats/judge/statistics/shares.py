"""How well a share is known from few trials, and from several flights of the same few episodes."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class KnownShare:
    """A share of successes with its interval."""

    successes: int
    trials: int
    share: float  # 0 … 1
    low: float  # of the interval, 0 … 1
    high: float
    effective: float  # independent trials that would tell as much: as many as there are, or fewer


def wilson(successes: float, trials: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Wilson's score interval (low, high) of a share; (0, 1) of no trial. Raises ValueError.

    Wilson, "Probable inference", J. Am. Stat. Assoc. 22 (1927). The counts may be fractions: effective ones.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is no share")
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share = successes / trials
    middle = share + z * z / (2 * trials)
    half = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    # at an end of the scale the interval holds that end, which rounding would miss by a hair
    low = 0.0 if successes == 0 else (middle - half) / scale
    return low, 1.0 if successes == trials else (middle + half) / scale


def known_share(flights: Sequence[Sequence[bool]], confidence: float = CONFIDENCE) -> KnownShare:
    """Return the share of successes over all flights of some episodes; `flights` holds each episode's own.

    Flights of one episode succeed and fail together, so that ten flights of one tell less than one of ten: episodes
    are the unit. The interval is Wilson's, of as many independent trials as would leave the share's variance over the
    episodes (linearised, Cochran, "Sampling Techniques", 1977, 6.4), at least the episodes and at most all flights.
    Of one flight each it is Wilson's own. Where every flight ended alike it counts each episode once.
    """
    episodes = [each for each in flights if each]
    trials, successes = sum(map(len, episodes)), sum(map(sum, episodes))
    if trials == 0:
        return KnownShare(0, 0, math.nan, 0.0, 1.0, 0.0)
    share = successes / trials
    effective = _effective(episodes, share, trials)
    low, high = wilson(share * effective, effective, confidence)
    return KnownShare(successes, trials, share, low, high, effective)


def _effective(episodes: Sequence[Sequence[bool]], share: float, trials: int) -> float:
    """Return how many independent trials tell as much of the share."""
    count = len(episodes)
    if count == trials or count == 1 or share in (0.0, 1.0):
        return float(count)
    residuals = (sum(each) - share * len(each) for each in episodes)
    variance = count / (count - 1) * sum(r * r for r in residuals) / trials**2
    return min(float(trials), max(float(count), share * (1 - share) / variance)) if variance else float(trials)


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
