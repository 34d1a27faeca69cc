"""Computes means and differences over episodes, with intervals and tests. All flights of an episode give one value."""

import functools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from dronecats.judge.statistics.shares import CONFIDENCE

Array = NDArray[np.float64]

ENUMERATED = 13  # episodes; up to this number all subsets are used
DRAWN = 1 << 12  # number of random subsets for more episodes; the complement of each subset is added
SHARE_FLIGHTS_MAX = 200  # flights of an episode; up to this number the test of shares is exact, within UNITS_MAX
UNITS_MAX = (
    100_000  # units of a share; the test has an array of up to half this size per episode. Finer shares are rounded
)
TIE = 1e-9  # relative to the largest value; smaller sums are rounding errors and count as 0


@dataclass(frozen=True, slots=True)
class KnownMean:
    episodes: int
    mean: float  # in the unit of the values; nan: no episode
    low: float | None  # lower end of the interval; None: too few episodes
    high: float | None


@dataclass(frozen=True, slots=True)
class MeanDifference(KnownMean):
    """A mean difference over episodes with its interval and the p of a test.

    Interval and test agree: 0 is outside of the interval if and only if p is at most 1 − CONFIDENCE.
    """

    p: float  # two-sided p-value; 1: no episode


def known_mean(values: Sequence[float]) -> KnownMean:
    """Return the mean of `values`, one per episode, with an interval within the range of the values.

    The ends of the interval are quantiles of the means over subsets (`_subsets`; Hartigan, "Using subsample values as
    typical values", J. Am. Stat. Assoc. 64, 1969). Fewer than 6 episodes are too few for 95 %.
    """
    if not len(values):
        return KnownMean(0, math.nan, None, None)
    count, mean = len(values), math.fsum(values) / len(values)
    means = np.sort(_subset_sums(values) / _subsets(count).sum(axis=1))
    # number of subsets beyond each end of the interval, including the empty subset
    outside = math.floor((1 - CONFIDENCE) * (len(means) + 1) / 2 + TIE)
    if not outside:
        return KnownMean(count, mean, None, None)
    return KnownMean(count, mean, min(mean, float(means[outside - 1])), max(mean, float(means[-outside])))


def mean_difference(differences: Sequence[float]) -> MeanDifference:
    """Return the mean of `differences`, one per episode, its interval, and the p of the mean's randomisation test.

    The test sums the differences with each choice of signs, and counts the sums that are at least as far from 0 as the
    observed sum (Fisher, "The Design of Experiments", 1935, 21). For more than 13 episodes it uses random choices. The
    interval is from `known_mean`, which agrees with this test.
    """
    estimate = known_mean(differences)
    if not estimate.episodes:
        return MeanDifference(0, math.nan, None, None, 1.0)
    # A choice of signs flips the signs of a subset. The total falls if the sum of the subset is positive.
    sums = _subset_sums(differences)
    lesser = min(int((sums <= 0).sum()), int((sums >= 0).sum())) + 1  # + 1 for the empty subset
    return MeanDifference(**asdict(estimate), p=min(1.0, 2 * lesser / (len(sums) + 1)))


def share_difference(differences: Sequence[float], flights: float = 1.0) -> MeanDifference:
    """Return the mean difference of two shares of successes. `differences` has one value per episode, -1 … 1.

    The interval is Agresti and Min's (Stat. Med. 24, 2005). A pair has one flight of each side. The interval adds half
    a pair to each of the four outcomes of a pair, so its width is never 0. `flights` is the mean number of flights
    per episode. An added pair has the weight 1 / `flights` of an episode, or 1 if all differences are equal, because
    equal differences do not show their scatter. p is the larger p of two tests: the exact randomisation test of the
    mean (McNemar's test for one flight each), and the test of the interval. If the exact test is not significant, the
    interval is extended to 0. Raises ValueError for a difference or `flights` out of range.
    """
    count = len(differences)
    if any(not -1 <= difference <= 1 for difference in differences) or flights < 1:
        raise ValueError("a difference of shares must be between -1 and 1, and have at least one flight")
    if count == 0:
        return MeanDifference(0, math.nan, None, None, 1.0)
    added = 2.0 / flights if len(set(differences)) > 1 else 2.0
    total, more = math.fsum(differences), count + added
    middle = total / more
    variance = (math.fsum(difference * difference for difference in differences) + added / 2) / more - middle * middle
    deviation = math.sqrt(variance / more)
    normal = NormalDist()
    reach = normal.inv_cdf(0.5 + CONFIDENCE / 2) * deviation
    low, high = max(-1.0, middle - reach), min(1.0, middle + reach)
    exact = _randomised_shares(differences)
    if exact > 1 - CONFIDENCE:
        low, high = min(low, 0.0), max(high, 0.0)
    p = max(exact, 2 * normal.cdf(-abs(middle) / deviation))
    return MeanDifference(count, total / count, low, high, p)


def _subset_sums(values: Sequence[float]) -> Array:
    """Return the sum of each of `_subsets`; a sum within rounding errors of 0 is 0."""
    side = -1.0 if math.fsum(values) < 0 else 1.0
    ordered = np.sort(side * np.asarray(values, dtype=float))  # so that rounding is the same for any order and sign
    sums: Array = _subsets(len(ordered)) @ ordered
    sums[np.abs(sums) <= TIE * np.abs(ordered).max()] = 0.0
    return side * sums


@functools.lru_cache(maxsize=32)
def _subsets(count: int) -> Array:
    """Return non-empty subsets, one per row with 1.0 for each member: all, or random ones if `count` > ENUMERATED."""
    if count <= ENUMERATED:
        return ((np.arange(1, 1 << count)[:, None] >> np.arange(count)) & 1).astype(float)
    drawn = np.random.default_rng(count).integers(0, 2, (DRAWN, count)).astype(float)
    subsets = np.vstack((drawn, 1.0 - drawn))
    return subsets[subsets.any(axis=1)]


def _randomised_shares(differences: Sequence[float]) -> float:
    """Return the exact two-sided p of the randomisation test of the mean of differences of shares."""
    sizes = _integers(np.sort(np.asarray(differences, dtype=float)))
    positive, total = int(sizes[sizes > 0].sum()), int(np.abs(sizes).sum())
    lesser = min(positive, total - positive)
    chances = np.zeros(lesser + 1)  # probability of each sum of the positive values up to `lesser`, over all signs
    chances[0] = 1.0
    for size in np.abs(sizes[sizes != 0]):
        chances *= 0.5
        chances[size:] += chances[: max(0, len(chances) - size)].copy()
    return min(1.0, 2 * float(chances.sum()))


def _integers(shares: Array) -> NDArray[np.int64]:
    """Return shares as integer multiples of their largest common unit 1 / n; rounded if n would exceed UNITS_MAX."""
    fractions = [Fraction(float(share)).limit_denominator(SHARE_FLIGHTS_MAX) for share in shares]
    common = min(math.lcm(*(fraction.denominator for fraction in fractions)), UNITS_MAX)
    return np.asarray([round(fraction * common) for fraction in fractions], dtype=np.int64)
