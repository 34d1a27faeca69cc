"""How much two conditions differ on the same episodes, whose several flights are no more evidence than one."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from dronecats.judge.statistics.shares import CONFIDENCE

Array = NDArray[np.float64]

ENUMERATED = 13  # episodes, up to which every subset is counted
DRAWN = 1 << 12  # random subsets of more episodes; the complement of each is taken too
SHARE_FLIGHTS_MAX = 200  # flights of an episode, up to which the test of shares is exact
TIE = 1e-9  # sums that are smaller than this part of the largest value are 0, whatever rounding made of them


@dataclass(frozen=True, slots=True)
class KnownMean:
    """A mean over episodes with its interval."""

    episodes: int
    mean: float  # in the unit of the values; nan: of no episode
    low: float | None  # None: too few episodes to tell
    high: float | None


@dataclass(frozen=True, slots=True)
class MeanDifference(KnownMean):
    """A mean difference over episodes with the p of a test that agrees with its interval.

    0 is outside of the interval exactly where p is at most 1 − confidence.
    """

    p: float  # two-sided; 1: of no episode


def known_mean(values: Sequence[float], confidence: float = CONFIDENCE) -> KnownMean:
    """Return the mean of a value an episode, with an interval that holds no value that the mean cannot have.

    The ends are quantiles of the means of all subsets of the episodes (Hartigan, "Using subsample values as typical
    values", J. Am. Stat. Assoc. 64, 1969), so that the interval lies between the least and the largest value. Fewer
    episodes than 6 are too few for 95 %.
    """
    if not len(values):
        return KnownMean(0, math.nan, None, None)
    count, mean = len(values), math.fsum(values) / len(values)
    means = np.sort(_subset_sums(values) / _subsets(count).sum(axis=1))
    outside = math.floor((1 - confidence) * (len(means) + 1) / 2 + TIE)  # subsets beyond an end, the empty one included
    if not outside:
        return KnownMean(count, mean, None, None)
    return KnownMean(count, mean, min(mean, float(means[outside - 1])), max(mean, float(means[-outside])))


def mean_difference(differences: Sequence[float], confidence: float = CONFIDENCE) -> MeanDifference:
    """Return the mean of a difference an episode with its interval and the p of the randomisation test of the mean.

    The test counts the choices of signs whose sum is as far from 0 (Fisher, "The Design of Experiments", 1935, 21);
    of more than 13 episodes, random ones. The interval of `known_mean` is that of this test.
    """
    known = known_mean(differences, confidence)
    if not known.episodes:
        return MeanDifference(0, math.nan, None, None, 1.0)
    # A choice of signs turns a subset over: the sum of all is not reached where the subset's own sum is positive.
    sums = _subset_sums(differences)
    lesser = min(int((sums <= 0).sum()), int((sums >= 0).sum())) + 1  # and the empty one
    return MeanDifference(known.episodes, known.mean, known.low, known.high, min(1.0, 2 * lesser / (len(sums) + 1)))


def share_difference(
    differences: Sequence[float], flights: float = 1.0, confidence: float = CONFIDENCE
) -> MeanDifference:
    """Return the mean difference of two shares of successes, a difference an episode, each -1 … 1.

    The interval is Agresti and Min's (Stat. Med. 24, 2005) for pairs of one flight each: half a pair is added to each
    of the four ways in which a pair can end, so that it is never of no width. Of several `flights` an episode, on the
    mean, a pair is that part of an episode, and an episode's difference counts by its square; where all episodes differ
    alike, which tells nothing of their scatter, each counts as one pair. The p is the exact randomisation test's of the
    mean, of one flight each McNemar's; or the interval's own where that is larger. Where the test finds nothing, the
    interval reaches to 0. Raises ValueError for what is no difference.
    """
    count = len(differences)
    if any(not -1 <= each <= 1 for each in differences) or flights < 1:
        raise ValueError("a difference of shares lies between -1 and 1, and is of one flight at least")
    if count == 0:
        return MeanDifference(0, math.nan, None, None, 1.0)
    added = 2.0 / flights if len(set(differences)) > 1 else 2.0
    whole, more = math.fsum(differences), count + added
    middle = whole / more
    variance = (math.fsum(each * each for each in differences) + added / 2) / more - middle * middle
    deviation = math.sqrt(variance / more)
    normal = NormalDist()
    reach = normal.inv_cdf(0.5 + confidence / 2) * deviation
    low, high = max(-1.0, middle - reach), min(1.0, middle + reach)
    exact = _randomised_shares(differences)
    if exact > 1 - confidence:
        low, high = min(low, 0.0), max(high, 0.0)
    p = max(exact, 2 * normal.cdf(-abs(middle) / deviation))
    return MeanDifference(count, whole / count, low, high, p)


def _subset_sums(values: Sequence[float]) -> Array:
    """Return the sum of each of `_subsets`; a sum that only rounding keeps from 0 is 0."""
    side = -1.0 if math.fsum(values) < 0 else 1.0
    ordered = np.sort(side * np.asarray(values, dtype=float))  # neither their order nor their direction matters
    sums: Array = _subsets(len(ordered)) @ ordered
    sums[np.abs(sums) <= TIE * np.abs(ordered).max()] = 0.0
    return side * sums


@functools.lru_cache(maxsize=32)
def _subsets(count: int) -> Array:
    """Return subsets that are not empty, a line each with 1.0 for what is in it: all, or of many values random ones."""
    if count <= ENUMERATED:
        return ((np.arange(1, 1 << count)[:, None] >> np.arange(count)) & 1).astype(float)
    drawn = np.random.default_rng(count).integers(0, 2, (DRAWN, count)).astype(float)
    both = np.vstack((drawn, 1.0 - drawn))
    return both[both.any(axis=1)]


def _randomised_shares(differences: Sequence[float]) -> float:
    """Return the exact two-sided p of the randomisation test of the mean of differences of shares."""
    sizes = _whole(np.sort(np.asarray(differences, dtype=float)))
    positive, total = int(sizes[sizes > 0].sum()), int(np.abs(sizes).sum())
    lesser = min(positive, total - positive)
    chances = np.zeros(lesser + 1)  # of each sum of the positive ones up to the lesser, over all choices of signs
    chances[0] = 1.0
    for size in np.abs(sizes[sizes != 0]):
        chances *= 0.5
        chances[size:] += chances[: max(0, len(chances) - size)].copy()
    return min(1.0, 2 * float(chances.sum()))


def _whole(shares: Array) -> NDArray[np.int64]:
    """Return shares as whole numbers of the largest part that all of them are multiples of."""
    for parts in range(1, SHARE_FLIGHTS_MAX + 1):
        whole = np.rint(shares * parts)
        if np.abs(shares * parts - whole).max() < TIE * SHARE_FLIGHTS_MAX:
            break
    return np.asarray(whole, dtype=np.int64)
