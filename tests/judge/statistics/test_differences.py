"""Differences of the same episodes against scipy and every choice of signs."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from dronecats.judge.statistics.differences import known_mean, mean_difference, share_difference
from dronecats.judge.statistics.shares import mcnemar
from tests.support.randomisation import randomised

numbers = st.floats(-100, 100)


@given(st.lists(st.floats(0, 1000), min_size=1, max_size=30))
def test_a_means_interval_holds_only_what_the_mean_can_be(values):
    told = known_mean(values)
    assert told.mean == pytest.approx(np.mean(values))
    assert (told.low is None) == (told.high is None) == (len(values) < 6)
    if told.low is not None and told.high is not None:
        assert min(values) - 1e-6 <= told.low <= told.high <= max(values) + 1e-6


@given(st.lists(numbers, max_size=25) | st.lists(st.integers(-2, 3).map(float), max_size=25))
def test_nought_is_outside_of_an_interval_exactly_where_the_test_tells_it(values):
    told = mean_difference(values)
    outside = told.low is not None and told.high is not None and not told.low <= 0 <= told.high
    assert outside == (told.p <= 0.05)


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=30))
def test_of_shares_too(flights):
    told = share_difference([each / 5 for each in flights], 5)
    assert told.low is not None
    assert told.high is not None
    assert (not told.low <= 0 <= told.high) == (told.p <= 0.05)
    assert told.p >= randomised([Fraction(each, 5) for each in flights]) - 1e-12


@pytest.mark.parametrize("episodes", [8, 20])
@pytest.mark.parametrize("draw", ["normal", "exponential"])
def test_a_mean_is_covered(episodes, draw):
    """As often as Student's interval does, which the skew of an exponential costs 4 points of 8 episodes."""
    rng, covered, sets = np.random.default_rng(7), {"own": 0, "student": 0}, 400
    for _ in range(sets):
        values = rng.normal(1.0, 1.0, episodes) if draw == "normal" else rng.exponential(1.0, episodes)
        own, student = known_mean(list(values)), stats.ttest_1samp(values, 0.0).confidence_interval()
        assert own.low is not None
        assert own.high is not None
        covered["own"] += own.low <= 1.0 <= own.high
        covered["student"] += student.low <= 1.0 <= student.high
    assert covered["own"] >= covered["student"] - 0.015 * sets
    assert draw == "exponential" or covered["own"] / sets == pytest.approx(0.95, abs=0.03)


def test_of_one_episode_there_is_no_interval_and_of_none_no_mean():
    assert (known_mean([3.0]).mean, known_mean([3.0]).low) == (3.0, None)
    assert math.isnan(known_mean([]).mean)
    assert math.isnan(share_difference([]).mean)


@given(st.lists(st.integers(-40, 40), min_size=1, max_size=13))
def test_of_few_episodes_the_test_counts_every_choice_of_signs(values):
    assert mean_difference([each / 10 for each in values]).p == pytest.approx(
        randomised([Fraction(v, 10) for v in values])
    )


def test_of_many_episodes_it_is_as_good_as_every_choice():
    for moved in (0.3, 0.5, 0.8):
        values = [round(each, 1) for each in np.random.default_rng(1).normal(moved, 1.0, 24)]
        assert mean_difference(values).p == pytest.approx(randomised(values), abs=0.01)


@given(st.integers(0, 25), st.integers(0, 25))
def test_of_one_flight_each_it_is_mcnemars(b, c):
    assert share_difference([1.0] * b + [-1.0] * c + [0.0] * 5).p == pytest.approx(mcnemar(b, c))


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
def test_of_one_flight_each_a_shares_difference_is_agresti_and_mins(b, c, same):
    if not b + c + same:
        return
    told = share_difference([1.0] * b + [-1.0] * c + [0.0] * same)
    n, one, other = b + c + same + 2, b + 0.5, c + 0.5  # their formula, with half a pair in each of the four cells
    middle = (one - other) / n
    reach = stats.norm.ppf(0.975) * math.sqrt((one + other) - (one - other) ** 2 / n) / n
    low, high = max(-1, middle - reach), min(1, middle + reach)
    tells = mcnemar(b, c) <= 0.05  # where the exact test finds nothing, 0 is in the interval
    assert told.low == pytest.approx(low if tells else min(0, low))
    assert told.high == pytest.approx(high if tells else max(0, high))
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
    told, turned = mean_difference(values), mean_difference([-each for each in values])
    assert mean_difference(mixed) == told
    assert turned.p == pytest.approx(told.p)
    assert (turned.low is None) == (told.high is None)


def test_where_all_episodes_differ_alike_their_flights_are_no_more_evidence():
    assert share_difference([0.0] * 10, 50.0) == share_difference([0.0] * 10)


def test_what_is_no_difference_of_shares_is_refused():
    with pytest.raises(ValueError, match="-1"):
        share_difference([1.5])
