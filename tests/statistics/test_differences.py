"""Differences of the same episodes against scipy, statsmodels and every choice of signs."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dronecats.statistics.differences import known_mean, share_difference, signed_rank
from dronecats.statistics.paired import mcnemar

numbers = st.floats(-100, 100)


@given(st.lists(numbers, min_size=2, max_size=40))
def test_a_mean_is_statsmodels_own(values):
    from statsmodels.stats.weightstats import DescrStatsW

    told = known_mean(values)
    if np.ptp(values) > 1e-6:
        assert (told.low, told.high) == pytest.approx(DescrStatsW(values).tconfint_mean(0.05), rel=1e-6, abs=1e-9)
    assert told.mean == pytest.approx(np.mean(values))


def test_of_one_episode_there_is_no_interval_and_of_none_no_mean():
    assert (known_mean([3.0]).mean, known_mean([3.0]).low) == (3.0, None)
    assert math.isnan(known_mean([]).mean)
    assert math.isnan(share_difference([]).mean)


@given(st.lists(numbers, min_size=1, max_size=30, unique_by=abs).filter(lambda v: 0.0 not in v))
def test_without_ties_it_is_scipys_exact_test(values):
    spread = np.abs(values)
    if np.diff(np.sort([0.0, *spread])).min() < 1e-6 * spread.max():
        return  # ties or zeros to one, none to the other
    assert signed_rank(values) == pytest.approx(stats.wilcoxon(values, method="exact").pvalue)


@given(st.lists(st.integers(-3, 3), max_size=9))
def test_with_ties_and_zeros_it_is_every_choice_of_signs(values):
    told = [each for each in values if each]
    ranks = stats.rankdata(np.abs(told)) if told else np.array([])
    middle = ranks.sum() / 2
    seen = abs(sum(rank for rank, each in zip(ranks, told, strict=True) if each > 0) - middle)
    sums = [abs(np.dot(signs, ranks) - middle) for signs in itertools.product((0, 1), repeat=len(told))]
    assert signed_rank(values) == pytest.approx(np.mean([each >= seen - 1e-9 for each in sums]))


@given(st.integers(0, 30), st.integers(0, 30))
def test_of_outcomes_alone_it_is_mcnemars(b, c):
    assert signed_rank([1.0] * b + [-1.0] * c + [0.0] * 5) == pytest.approx(mcnemar(b, c))


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
def test_of_one_flight_each_a_shares_difference_is_agresti_and_mins(b, c, same):
    if not b + c + same:
        return
    told = share_difference([1.0] * b + [-1.0] * c + [0.0] * same)
    n, one, other = b + c + same + 2, b + 0.5, c + 0.5  # their formula, with half a pair in each of the four cells
    middle = (one - other) / n
    reach = stats.norm.ppf(0.975) * math.sqrt((one + other) - (one - other) ** 2 / n) / n
    assert told.low == pytest.approx(max(-1, middle - reach))
    assert told.high == pytest.approx(min(1, middle + reach))
    assert told.low is not None
    assert told.high is not None
    assert told.low < told.high


@pytest.mark.parametrize(("episodes", "flights"), [(20, 1), (20, 2), (14, 6)])
def test_a_shares_difference_is_covered(episodes, flights):
    """Episodes of several chances, some flights each at each of two levels: 95 % means what it says."""
    rng, covered, sets, truth = np.random.default_rng(5), 0, 300, _mean_difference(0.3, 1.2, 1.0)
    for _ in range(sets):
        odds = rng.normal(0.3, 1.2, episodes)
        first, second = 1 / (1 + np.exp(-odds)), 1 / (1 + np.exp(-(odds - 1.0)))
        told = share_difference(list((rng.binomial(flights, first) - rng.binomial(flights, second)) / flights), flights)
        assert told.low is not None
        assert told.high is not None
        covered += told.low <= truth <= told.high
    assert covered / sets == pytest.approx(0.95, abs=0.035)


def _mean_difference(middle: float, scatter: float, moved: float) -> float:
    odds = np.random.default_rng(0).normal(middle, scatter, 400_000)
    return float(np.mean(1 / (1 + np.exp(-odds)) - 1 / (1 + np.exp(moved - odds))))


@given(st.lists(numbers, min_size=1, max_size=25), st.randoms())
def test_neither_order_nor_direction_matters(values, random):
    mixed = random.sample(values, len(values))
    assert signed_rank(mixed) == signed_rank(values) == pytest.approx(signed_rank([-each for each in values]))
    assert known_mean(mixed) == known_mean(values)


def test_where_all_episodes_differ_alike_their_flights_are_no_more_evidence():
    assert share_difference([0.0] * 10, 50.0) == share_difference([0.0] * 10)


def test_what_is_no_difference_of_shares_is_refused():
    with pytest.raises(ValueError, match="-1"):
        share_difference([1.5])
