"""Intervals of shares against statsmodels, and what several flights of the same episodes are worth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.judge.statistics.shares import known_share, wilson


@given(st.integers(0, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.floats(0.5, 0.999))
def test_wilson_is_statsmodels_own(counted, confidence):
    from statsmodels.stats.proportion import proportion_confint

    successes, trials = counted
    if trials:
        expected = proportion_confint(successes, trials, 1 - confidence, method="wilson")
        assert wilson(successes, trials, confidence) == pytest.approx(expected, abs=1e-12)


def test_wilson_of_the_papers_cell():
    # 13 of 20, Gemini 3.7 Flash approaching, computed by hand from z = 1.959964
    assert wilson(13, 20) == pytest.approx((0.4329, 0.8188), abs=5e-5)
    assert wilson(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match="3 of 2"):
        wilson(3, 2)


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_one_flight_of_each_episode_is_wilsons_own(outcomes):
    known = known_share([[each] for each in outcomes])
    assert (known.low, known.high) == pytest.approx(wilson(sum(outcomes), len(outcomes)))
    assert (known.successes, known.trials, known.effective) == (sum(outcomes), len(outcomes), len(outcomes))


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(1, 5))
def test_the_same_flight_again_tells_nothing_new(outcomes, times):
    once, again = known_share([[each] for each in outcomes]), known_share([[each] * times for each in outcomes])
    assert (again.low, again.high) == pytest.approx((once.low, once.high))


@given(st.lists(st.lists(st.booleans(), min_size=1, max_size=6), min_size=1, max_size=40))
def test_flights_are_worth_between_the_episodes_and_all_of_them(flights):
    known = known_share(flights)
    assert len(flights) - 1e-9 <= known.effective <= sum(map(len, flights)) + 1e-9
    assert known.low <= known.share <= known.high


def test_what_flights_are_worth_by_hand():
    """Residuals ¾, -¼, -5⁄4, ¾ about five of eight: a variance of 4⁄3 · 2.75 ⁄ 64, and ¼ · 15⁄16 over it."""
    known = known_share([[True, True], [True, False], [False, False], [True, True]])
    assert (known.share, known.effective) == pytest.approx((0.625, 0.234375 / (4 / 3 * 2.75 / 64)))


def test_flights_that_are_independent_are_worth_nearly_all_of_them():
    rng = np.random.default_rng(1)
    flights = (rng.random((400, 3)) < 0.5).tolist()
    assert known_share(flights).effective > 1000


def test_it_holds_the_true_share_as_often_as_it_says_where_plain_wilson_does_not():
    """Twenty episodes of very different difficulty, three flights each, as in the paper's variance study."""
    rng, held, plain = np.random.default_rng(7), 0, 0
    for _ in range(2000):
        chances = rng.beta(0.3, 0.3, 20)  # most are nearly always or nearly never solved
        flights = rng.random((20, 3)) < chances[:, None]
        known = known_share(flights.tolist())
        held += known.low <= 0.5 <= known.high
        low, high = wilson(int(flights.sum()), flights.size)
        plain += low <= 0.5 <= high
    assert held / 2000 > 0.93
    assert plain / 2000 < 0.85
    assert known_share([]).trials == 0
