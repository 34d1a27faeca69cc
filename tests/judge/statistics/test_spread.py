"""The spread between flights, compared with binomial chance."""

import math

import numpy as np
import pytest
from scipy import stats

from dronecats.judge.statistics.shares import binomial_deviation, deviation_interval, spread


def of_totals(totals, episodes):
    return [[k < total for k in range(episodes)] for total in totals]


def test_the_spread_matches_the_papers_three_flights():
    """Table "Three full-suite flights": 46, 50 and 35 of 80, reported as 43.7 ± 7.8, and ± 1.7 to 2.5 per cell."""
    suite = spread(of_totals([46, 50, 35], 80))
    assert (suite.mean, suite.deviation) == pytest.approx((43.7, 7.8), abs=0.05)
    cells = [[13, 13, 10], [8, 7, 4], [16, 19, 14], [9, 11, 7]]
    deviations = [spread(of_totals(totals, 20)).deviation for totals in cells]
    assert deviations == pytest.approx([1.7, 2.1, 2.5, 2.0], abs=0.05)
    expected = [spread(of_totals(totals, 20)).binomial for totals in cells]
    assert expected == pytest.approx([stats.binom(20, sum(t) / 60).std() for t in cells])


@pytest.mark.parametrize(("trials", "share"), [(20, 0.0), (20, 0.35), (80, 0.5), (1, 1.0)])
def test_binomial_deviation_equals_scipy(trials, share):
    assert binomial_deviation(share, trials) == pytest.approx(stats.binom(trials, share).std())


def test_the_interval_of_a_deviation_follows_chi_square():
    low, high = deviation_interval(2.0, 3)
    assert (low, high) == pytest.approx(tuple(2.0 * math.sqrt(2 / stats.chi2(2).ppf(q)) for q in (0.975, 0.025)))
    rng, held = np.random.default_rng(3), 0
    for _ in range(2000):
        low, high = deviation_interval(float(np.std(rng.normal(0, 3, 3), ddof=1)), 3)
        held += low <= 3 <= high
    assert 0.94 < held / 2000 < 0.96


def test_the_interval_of_a_deviation_contains_only_possible_values():
    two_flights = spread(of_totals([14, 15], 20))  # chi-square alone would allow up to 22.6 of 20 episodes
    assert two_flights.low is not None
    assert two_flights.high is not None
    assert 0 < two_flights.low < math.sqrt(0.5) < two_flights.high <= 10


def test_episodes_of_different_difficulty_scatter_less_than_episodes_of_equal_difficulty():
    always = spread([[True] * 10 + [False] * 10] * 3)
    assert (always.deviation, always.binomial_by_episode) == (0.0, 0.0)
    assert always.binomial == pytest.approx(math.sqrt(5))
    rng = np.random.default_rng(5)
    chances = np.tile([0.1, 0.5, 0.9], 400)
    simulated = spread((rng.random((4, 1200)) < chances).tolist())
    assert simulated.binomial_by_episode == pytest.approx(math.sqrt((chances * (1 - chances)).sum()), rel=0.05)


def test_one_flight_has_no_spread_and_different_episodes_are_rejected():
    alone = spread([[True, False]])
    assert (alone.deviation, alone.low, alone.binomial_by_episode) == (None, None, None)
    different: list[list[list[bool]]] = [[], [[]], [[True], [True, False]]]
    for flights in different:
        with pytest.raises(ValueError, match="episodes"):
            spread(flights)
