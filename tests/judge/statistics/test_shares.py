"""Intervals of shares, compared with statsmodels, and the effective number of repeated flights of episodes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.statistics.shares import estimate_share, wilson


@given(st.integers(0, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.floats(0.5, 0.999))
def test_wilson_equals_statsmodels(counted, confidence):
    from statsmodels.stats.proportion import proportion_confint

    successes, trials = counted
    if trials:
        expected = proportion_confint(successes, trials, 1 - confidence, method="wilson")
        assert wilson(successes, trials, confidence) == pytest.approx(expected, abs=1e-12)


def test_wilson_matches_a_cell_of_the_paper():
    # 13 of 20, Gemini 3.7 Flash approaching, computed by hand from z = 1.959964
    assert wilson(13, 20) == pytest.approx((0.4329, 0.8188), abs=5e-5)
    assert wilson(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 of 2"):
        wilson(3, 2)


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_the_interval_equals_wilson_for_one_flight_per_episode(outcomes):
    estimate = estimate_share([[outcome] for outcome in outcomes])
    assert (estimate.low, estimate.high) == pytest.approx(wilson(sum(outcomes), len(outcomes)))
    assert (estimate.successes, estimate.trials, estimate.effective) == (sum(outcomes), len(outcomes), len(outcomes))


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(1, 5))
def test_repeated_identical_outcomes_do_not_change_the_interval(outcomes, times):
    once, again = (
        estimate_share([[outcome] for outcome in outcomes]),
        estimate_share([[outcome] * times for outcome in outcomes]),
    )
    assert (again.low, again.high) == pytest.approx((once.low, once.high))


@given(st.lists(st.lists(st.booleans(), min_size=1, max_size=6), min_size=1, max_size=40))
def test_the_effective_number_is_between_the_episodes_and_the_flights(flights):
    estimate = estimate_share(flights)
    assert len(flights) - 1e-9 <= estimate.effective <= sum(map(len, flights)) + 1e-9
    assert estimate.low <= estimate.share <= estimate.high


def test_the_effective_number_of_flights_matches_a_hand_calculation():
    """The residuals are ¾, -¼, -5⁄4, ¾ about 5⁄8; their variance is 4⁄3 · 2.75 ⁄ 64. Effective: ¼ · 15⁄16 over it."""
    estimate = estimate_share([[True, True], [True, False], [False, False], [True, True]])
    assert (estimate.share, estimate.effective) == pytest.approx((0.625, 0.234375 / (4 / 3 * 2.75 / 64)))


def test_the_effective_number_of_independent_flights_is_near_their_number():
    rng = np.random.default_rng(1)
    flights = (rng.random((400, 3)) < 0.5).tolist()
    assert estimate_share(flights).effective > 1000


def test_the_interval_covers_the_true_share_though_plain_wilson_does_not():
    """20 episodes of very different difficulty with three flights each, as in the paper's variance study."""
    rng, held, plain = np.random.default_rng(7), 0, 0
    for _ in range(2000):
        chances = rng.beta(0.3, 0.3, 20)  # most episodes are solved nearly always or nearly never
        flights = rng.random((20, 3)) < chances[:, None]
        estimate = estimate_share(flights.tolist())
        held += estimate.low <= 0.5 <= estimate.high
        low, high = wilson(int(flights.sum()), flights.size)
        plain += low <= 0.5 <= high
    assert held / 2000 > 0.93
    assert plain / 2000 < 0.85
    assert estimate_share([]).trials == 0
