"""Paired differences, compared with scipy and with the permutation test over all signs."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from dronecats.judge.statistics.differences import _randomised_shares, known_mean, mean_difference, share_difference
from dronecats.judge.statistics.shares import mcnemar
from tests.support.randomisation import randomised

numbers = st.floats(-100, 100)


@given(st.lists(st.floats(0, 1000), min_size=1, max_size=30))
def test_the_interval_of_a_mean_lies_within_the_range_of_the_values(values):
    estimate = known_mean(values)
    assert estimate.mean == pytest.approx(np.mean(values))
    assert (estimate.low is None) == (estimate.high is None) == (len(values) < 6)
    if estimate.low is not None and estimate.high is not None:
        assert min(values) - 1e-6 <= estimate.low <= estimate.high <= max(values) + 1e-6


@given(st.lists(numbers, max_size=25) | st.lists(st.integers(-2, 3).map(float), max_size=25))
def test_the_interval_of_a_mean_difference_excludes_zero_exactly_if_significant(values):
    difference = mean_difference(values)
    outside = difference.low is not None and difference.high is not None and not difference.low <= 0 <= difference.high
    assert outside == (difference.p <= 0.05)


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=30))
def test_the_interval_of_a_share_difference_excludes_zero_exactly_if_significant(flights):
    difference = share_difference([won / 5 for won in flights], 5)
    assert difference.low is not None
    assert difference.high is not None
    assert (not difference.low <= 0 <= difference.high) == (difference.p <= 0.05)
    assert difference.p >= randomised([Fraction(won, 5) for won in flights]) - 1e-12


@given(st.lists(st.sampled_from([7, 8, 9, 10]).flatmap(lambda n: st.builds(Fraction, st.integers(-n, n), st.just(n))),
                min_size=1, max_size=8))  # fmt: skip
@example([*map(Fraction, ("-1/9", "3/10", "2/7", "-2/9", "1/3", "1/10"))])
def test_the_test_of_shares_is_exact_for_episodes_with_different_numbers_of_flights(shares):
    assert _randomised_shares([float(share) for share in shares]) == pytest.approx(randomised(shares))


def test_shares_without_a_small_common_unit_are_rounded():
    shares = [1 / 199, -1 / 197, 1 / 193, -1 / 191]
    assert _randomised_shares(shares) == pytest.approx(randomised([Fraction(1, n) for n in (199, -197, 193, -191)]))


@pytest.mark.parametrize("episodes", [8, 20])
@pytest.mark.parametrize("draw", ["normal", "exponential"])
def test_the_interval_of_a_mean_covers_the_true_mean_as_often_as_students(episodes, draw):
    """Coverage is at least that of Student's interval. An exponential costs 4 percentage points with 8 episodes."""
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


def test_one_episode_has_no_interval_and_none_has_no_mean():
    assert (known_mean([3.0]).mean, known_mean([3.0]).low) == (3.0, None)
    assert math.isnan(known_mean([]).mean)
    assert math.isnan(share_difference([]).mean)


@given(st.lists(st.integers(-40, 40), min_size=1, max_size=13))
def test_the_test_is_an_exact_sign_permutation_test_for_few_episodes(values):
    assert mean_difference([value / 10 for value in values]).p == pytest.approx(
        randomised([Fraction(value, 10) for value in values])
    )


def test_the_test_is_near_the_exact_permutation_test_for_many_episodes():
    for moved in (0.3, 0.5, 0.8):
        values = [round(value, 1) for value in np.random.default_rng(1).normal(moved, 1.0, 24)]
        assert mean_difference(values).p == pytest.approx(randomised(values), abs=0.01)


@given(st.integers(0, 25), st.integers(0, 25))
def test_the_test_equals_mcnemar_for_one_flight_per_episode(b, c):
    assert share_difference([1.0] * b + [-1.0] * c + [0.0] * 5).p == pytest.approx(mcnemar(b, c))


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
def test_the_interval_follows_agresti_and_min_for_one_flight_per_episode(b, c, same):
    if not b + c + same:
        return
    difference = share_difference([1.0] * b + [-1.0] * c + [0.0] * same)
    n, b_half, c_half = b + c + same + 2, b + 0.5, c + 0.5  # their formula adds 0.5 to each of the four cells
    middle = (b_half - c_half) / n
    reach = stats.norm.ppf(0.975) * math.sqrt((b_half + c_half) - (b_half - c_half) ** 2 / n) / n
    low, high = max(-1, middle - reach), min(1, middle + reach)
    is_significant = mcnemar(b, c) <= 0.05  # otherwise the interval contains 0
    assert difference.low == pytest.approx(low if is_significant else min(0, low))
    assert difference.high == pytest.approx(high if is_significant else max(0, high))
    assert difference.low is not None
    assert difference.high is not None
    assert difference.low < difference.high


@pytest.mark.parametrize(("episodes", "flights"), [(20, 1), (20, 2), (14, 6)])
def test_the_interval_of_a_share_difference_covers_the_true_difference(episodes, flights):
    """Episodes have different success probabilities, with `flights` flights at each of two levels."""
    rng, covered, sets, truth = np.random.default_rng(5), 0, 300, _mean_difference(0.3, 1.2, 1.0)
    for _ in range(sets):
        odds = rng.normal(0.3, 1.2, episodes)
        first, second = 1 / (1 + np.exp(-odds)), 1 / (1 + np.exp(-(odds - 1.0)))
        difference = share_difference(
            list((rng.binomial(flights, first) - rng.binomial(flights, second)) / flights), flights
        )
        assert difference.low is not None
        assert difference.high is not None
        covered += difference.low <= truth <= difference.high
    assert covered / sets == pytest.approx(0.95, abs=0.035)


def _mean_difference(middle: float, scatter: float, moved: float) -> float:
    odds = np.random.default_rng(0).normal(middle, scatter, 400_000)
    return float(np.mean(1 / (1 + np.exp(-odds)) - 1 / (1 + np.exp(moved - odds))))


@given(st.lists(numbers, min_size=1, max_size=25), st.randoms())
def test_the_order_of_the_values_and_the_direction_do_not_matter(values, random):
    mixed = random.sample(values, len(values))
    difference, turned = mean_difference(values), mean_difference([-value for value in values])
    assert mean_difference(mixed) == difference
    assert turned.p == pytest.approx(difference.p)
    assert (turned.low is None) == (difference.high is None)


def test_more_flights_of_equal_episodes_add_no_evidence():
    assert share_difference([0.0] * 10, 50.0) == share_difference([0.0] * 10)


def test_invalid_differences_of_shares_are_rejected():
    with pytest.raises(ValueError, match="-1"):
        share_difference([1.5])
