"""How much two conditions differ on the same episodes, whose several flights are no more evidence than one."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from statistics import NormalDist

from dronecats.statistics.shares import CONFIDENCE

FINEST = 10**9  # differences that agree to this part of the largest are ties, whatever rounding made of them


@dataclass(frozen=True, slots=True)
class KnownMean:
    """A mean over episodes with its interval."""

    episodes: int
    mean: float  # in the unit of the values; nan: of no episode
    low: float | None  # None: of one episode alone nobody knows
    high: float | None


def known_mean(values: Sequence[float], confidence: float = CONFIDENCE) -> KnownMean:
    """Return the mean of a value an episode, or of the differences of two, with Student's interval."""
    count = len(values)
    if count == 0:
        return KnownMean(0, math.nan, None, None)
    mean = math.fsum(values) / count
    if count == 1:
        return KnownMean(1, mean, None, None)
    from scipy.special import stdtrit  # a base dependency, but slow to import for whoever needs it not

    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (count - 1))
    reach = float(stdtrit(count - 1, 0.5 + confidence / 2)) * deviation / math.sqrt(count)
    return KnownMean(count, mean, mean - reach, mean + reach)


def share_difference(differences: Sequence[float], flights: float = 1.0, confidence: float = CONFIDENCE) -> KnownMean:
    """Return the mean difference of two shares of successes, a difference an episode, each -1 … 1.

    The interval is Agresti and Min's (Stat. Med. 24, 2005) for pairs of one flight each: half a pair is added to each
    of the four ways in which a pair can end, so that it is never of no width. Of several `flights` an episode, on the
    mean, a pair is that part of an episode, and an episode's difference counts by its square; where all episodes differ
    alike, which tells nothing of their scatter, each counts as one pair. Raises ValueError for what is no difference.
    """
    count = len(differences)
    if any(not -1 <= each <= 1 for each in differences) or flights < 1:
        raise ValueError("a difference of shares lies between -1 and 1, and is of one flight at least")
    if count == 0:
        return KnownMean(0, math.nan, None, None)
    added = 2.0 / flights if len(set(differences)) > 1 else 2.0
    whole, more = math.fsum(differences), count + added
    middle = whole / more
    variance = (math.fsum(each * each for each in differences) + added / 2) / more - middle * middle
    reach = NormalDist().inv_cdf(0.5 + confidence / 2) * math.sqrt(variance / more)
    return KnownMean(count, whole / count, max(-1.0, middle - reach), min(1.0, middle + reach))


def signed_rank(differences: Sequence[float]) -> float:
    """Return the exact two-sided p of Wilcoxon's signed-rank test; 1 where no difference is other than 0.

    Differences of 0 are left out and ties share their ranks; every choice of signs is counted, whatever the ties
    (Hollander, Wolfe and Chicken, "Nonparametric Statistical Methods", 2014, 3.1).
    """
    largest = max((abs(each) for each in differences), default=0.0)
    if largest == 0.0:
        return 1.0
    sizes = [round(Fraction(each) / Fraction(largest) * FINEST) for each in differences]
    told = sorted(size for size in sizes if size)
    doubled = _doubled_ranks([abs(size) for size in told])
    positive = sum(rank for size, rank in zip(told, doubled, strict=True) if size > 0)
    ways = [1]  # how many choices of signs give each sum of doubled ranks
    for rank in doubled:
        ways = [a + b for a, b in zip(ways + [0] * rank, [0] * rank + ways, strict=True)]
    lesser = min(positive, sum(doubled) - positive)
    return min(1.0, float(Fraction(2 * sum(ways[: lesser + 1]), 1 << len(doubled))))


def _doubled_ranks(sizes: Sequence[int]) -> list[int]:
    """Return twice the rank of each: whole numbers, also where ties share a rank."""
    below: dict[int, int] = {}
    equal: dict[int, int] = {}
    for place, size in enumerate(sorted(sizes)):
        below.setdefault(size, place)
        equal[size] = equal.get(size, 0) + 1
    return [2 * below[size] + equal[size] + 1 for size in sizes]
