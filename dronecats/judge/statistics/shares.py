"""Computes intervals of success shares from few trials, and exact comparisons of two pilots on the same episodes."""

import functools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class ShareEstimate:
    successes: int
    trials: int
    share: float  # 0 … 1
    low: float  # lower end of the interval, 0 … 1
    high: float
    effective: float  # number of independent trials with the same information, at most `trials`


def wilson(successes: float, trials: float, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Wilson's score interval (low, high) of a share; (0, 1) without trials.

    The counts may be fractions, such as effective counts. Raises ValueError for more successes than trials. Source:
    Wilson, "Probable inference", J. Am. Stat. Assoc. 22 (1927).
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is not a share")
    if trials == 0:
        return 0.0, 1.0
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share = successes / trials
    middle = share + z * z / (2 * trials)
    half = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    # the interval includes 0 without successes, and 1 without failures; rounding could miss them
    low = 0.0 if successes == 0 else (middle - half) / scale
    return low, 1.0 if successes == trials else (middle + half) / scale


def estimate_share(flights: Sequence[Sequence[bool]]) -> ShareEstimate:
    """Return the share of successes over all flights of some episodes; `flights` has the outcomes of each episode.

    Flights of one episode are correlated, so ten flights of one episode carry less information than one flight of each
    of ten episodes. The interval is Wilson's for an effective number of trials. With so many independent trials, the
    share has the same variance (linearised: Cochran, "Sampling Techniques", 1977, 6.4). The effective number is at
    least the number of episodes, and at most the number of flights. It is the number of episodes if all flights have
    the same outcome, or if there is only one episode.
    """
    episodes = [outcomes for outcomes in flights if outcomes]
    trials, successes = sum(map(len, episodes)), sum(map(sum, episodes))
    if trials == 0:
        return ShareEstimate(0, 0, math.nan, 0.0, 1.0, 0.0)
    share = successes / trials
    effective = _effective(episodes, share, trials)
    low, high = wilson(share * effective, effective)
    return ShareEstimate(successes, trials, share, low, high, effective)


def _effective(episodes: Sequence[Sequence[bool]], share: float, trials: int) -> float:
    """Return the number of independent trials with the same information about the share."""
    count = len(episodes)
    if count == trials or count == 1 or share in (0.0, 1.0):
        return float(count)
    residuals = (sum(outcomes) - share * len(outcomes) for outcomes in episodes)
    variance = count / (count - 1) * sum(r * r for r in residuals) / trials**2
    return min(float(trials), max(float(count), share * (1 - share) / variance)) if variance else float(trials)


@dataclass(frozen=True, slots=True)
class Spread:
    """The spread of the number of successes over several flights. Here a flight is one pass over the same episodes."""

    totals: tuple[int, ...]  # number of successes of each flight
    episodes: int  # number of episodes of each flight
    mean: float  # mean number of successes
    deviation: float | None  # standard deviation of the number of successes; None: one flight
    low: float | None  # lower end of the interval of `deviation`; assumes normal totals
    high: float | None  # upper end; at most half of the episodes, but at least `deviation`
    binomial: float  # expected deviation if all episodes are equally hard, sqrt(n p (1 - p)) in the paper
    binomial_by_episode: float | None  # expected deviation if each episode has its own success rate; None: one flight


def spread(flights: Sequence[Sequence[bool]]) -> Spread:
    """Return the spread of flights. Each flight is a sequence of outcomes of the same episodes in the same order.

    Raises ValueError without flights, or for flights of different lengths.
    """
    if not flights or not flights[0] or len({len(flight) for flight in flights}) > 1:
        raise ValueError("a spread needs flights of the same episodes, at least one of each")
    totals, episodes = tuple(map(sum, flights)), len(flights[0])
    mean = statistics.fmean(totals)
    deviation = statistics.stdev(totals) if len(totals) > 1 else None
    low, high = (None, None) if deviation is None else deviation_interval(deviation, len(totals))
    if high is not None and deviation is not None:  # the true deviation of totals cannot exceed half of the episodes
        high = max(deviation, min(high, episodes / 2))
    return Spread(
        totals=totals,
        episodes=episodes,
        mean=mean,
        deviation=deviation,
        low=low,
        high=high,
        binomial=binomial_deviation(mean / episodes, episodes),
        binomial_by_episode=_by_episode(flights) if len(flights) > 1 else None,
    )


def binomial_deviation(share: float, trials: int) -> float:
    """Return the standard deviation of the number of successes in independent trials with success rate `share`."""
    return math.sqrt(trials * share * (1.0 - share))


def deviation_interval(deviation: float, count: int) -> tuple[float, float]:
    """Return the interval (chi-square) of the standard deviation of `count` normal values."""
    from scipy.special import chdtri  # a base dependency, but slow to import

    freedom, tail = count - 1, (1 - CONFIDENCE) / 2
    square = freedom * deviation * deviation
    return math.sqrt(square / chdtri(freedom, tail)), math.sqrt(square / chdtri(freedom, 1 - tail))


def _by_episode(flights: Sequence[Sequence[bool]]) -> float:
    """Return the standard deviation of the totals of independent flights.

    The variance is the sum of the (unbiased) variances of the episodes.
    """
    episodes = zip(*flights, strict=True)
    return math.sqrt(sum(statistics.variance(map(float, outcomes)) for outcomes in episodes))


def holm(ps: Sequence[float]) -> list[float]:
    """Return the adjusted p-value of each test, in the order of `ps`.

    The adjustment limits the probability of at least one false finding. Source: Holm, "A simple sequentially
    rejective multiple test procedure", Scand. J. Stat. 6 (1979).
    """
    adjusted, least = [0.0] * len(ps), 0.0
    for rank, k in enumerate(sorted(range(len(ps)), key=ps.__getitem__)):
        least = max(least, min(1.0, (len(ps) - rank) * ps[k]))
        adjusted[k] = least
    return adjusted


ALPHA = 0.05  # two-sided level of significance
POWER = 0.8  # probability that a test finds a difference


@dataclass(frozen=True, slots=True)
class Paired:
    """The comparison of two pilots over the episodes that both pilots have flown."""

    episodes: int
    only_first: int  # episodes that the first pilot solved more often than the second: McNemar's b
    only_second: int  # episodes that the second pilot solved more often: McNemar's c
    difference: float  # share of successes of the first pilot minus the second pilot's share, -1 … 1
    p: float  # exact two-sided p-value
    smallest: float | None  # `smallest_difference` for the observed value of `discordant`; None: too few episodes


def paired(first: Sequence[Sequence[bool]], second: Sequence[Sequence[bool]]) -> Paired:
    """Return the comparison of two pilots on the same episodes.

    `first` and `second` have the outcomes of each episode's flights, with the episodes in the same order. The episode
    is the unit: it counts for the pilot with the larger share of successes, and for neither if the shares are equal.
    With one flight per episode this is McNemar's exact test. Raises ValueError if the numbers of episodes differ or an
    episode has no flight.
    """
    if len(first) != len(second) or not all(map(len, (*first, *second))):
        raise ValueError("a paired comparison needs flights of the same episodes on both sides")
    shares = [(sum(a) / len(a), sum(b) / len(b)) for a, b in zip(first, second, strict=True)]
    b, c = sum(x > y for x, y in shares), sum(x < y for x, y in shares)
    count = len(shares)
    return Paired(
        episodes=count,
        only_first=b,
        only_second=c,
        difference=math.fsum(x - y for x, y in shares) / count if count else 0.0,
        p=mcnemar(b, c),
        smallest=smallest_difference(count, (b + c) / count) if count else None,
    )


def mcnemar(b: int, c: int) -> float:
    """Return the exact two-sided p-value of McNemar's test for b and c discordant pairs; 1 without pairs."""
    tail = sum(math.comb(b + c, k) for k in range(min(b, c) + 1))
    return min(1.0, 2 * tail / (1 << (b + c)))  # integers until here, so nothing is rounded


def smallest_difference(episodes: int, discordant: float = 0.0) -> float | None:
    """Return the smallest true difference in success rate that McNemar's exact test detects with the power POWER.

    It assumes that the share of episodes with different outcomes is `discordant`, or the difference if that is larger.
    Accurate to 0.0001. None: too few episodes for any difference.
    """
    if mcnemar_power(episodes, 1.0, 1.0) < POWER:
        return None
    low, high = 0.0, 1.0
    while high - low > 1e-4:
        middle = (low + high) / 2
        enough = mcnemar_power(episodes, middle, max(discordant, middle)) >= POWER
        low, high = (low, middle) if enough else (middle, high)
    return high


def mcnemar_power(episodes: int, difference: float, discordant: float) -> float:
    """Return the exact power of McNemar's exact test: the probability of p ≤ ALPHA.

    `discordant` is the true share of episodes with different outcomes, at least `difference`.
    """
    first = (discordant + difference) / (2 * discordant) if discordant else 0.5
    chance = 0.0
    for pairs in range(1, episodes + 1):
        most = _largest_significant_minority(pairs)
        if most < 0:
            continue
        rejected = math.fsum(_binomial(k, pairs, first) + _binomial(pairs - k, pairs, first) for k in range(most + 1))
        chance += _binomial(pairs, episodes, discordant) * rejected
    return chance


@functools.cache
def _largest_significant_minority(pairs: int) -> int:
    """Return the largest number of discordant pairs, of `pairs`, that may favour the weaker pilot while p ≤ ALPHA.

    -1: p > ALPHA even if all of them favour one pilot.
    """
    most = -1
    while 2 * (most + 1) < pairs and mcnemar(most + 1, pairs - most - 1) <= ALPHA:
        most += 1
    return most


def _binomial(k: int, n: int, share: float) -> float:
    if share in (0.0, 1.0):
        return float(k == n * share)
    logs = math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
    return math.exp(logs + k * math.log(share) + (n - k) * math.log1p(-share))
