"""Compares paired comparisons with statsmodels, and their power with a simulation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, stats

from dronecats.judge.statistics.shares import mcnemar, mcnemar_power, paired, smallest_difference


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_equals_statsmodels(b, c):
    from statsmodels.stats.contingency_tables import mcnemar as statsmodels_mcnemar

    assert mcnemar(b, c) == pytest.approx(statsmodels_mcnemar([[7, b], [c, 3]], exact=True).pvalue)


def test_pairs_are_counted_by_episode():
    first = [[True], [True], [False], [True]]
    second = [[False], [True], [True], [False]]
    comparison = paired(first, second)
    assert (comparison.episodes, comparison.only_first, comparison.only_second, comparison.difference) == (
        4,
        2,
        1,
        0.25,
    )
    assert comparison.p == mcnemar(2, 1) == 1.0


def test_several_flights_of_one_episode_count_as_one_pair():
    """An episode counts for the side that solves it in more of its flights. A tie counts for neither side."""
    first = [[True, True, False], [True, True, True], [False, True, False]]
    second = [[False, True, False], [True, True, True], [True, True, False]]
    comparison = paired(first, second)
    assert (comparison.episodes, comparison.only_first, comparison.only_second) == (3, 1, 1)
    assert comparison.difference == pytest.approx(0.0)
    assert paired([[True] * 50] * 3, [[False] * 50] * 3).p == 0.25  # 3 pairs, for any number of flights


def test_different_or_missing_episodes_are_rejected():
    unequal: list[list[list[bool]]] = [[], [[]]]
    for second in unequal:
        with pytest.raises(ValueError, match="episodes"):
            paired([[True]], second)


@pytest.mark.parametrize(("episodes", "difference", "discordant"), [(20, 0.4, 0.4), (80, 0.2, 0.3), (100, 0.05, 0.5)])
def test_the_power_agrees_with_a_simulation(episodes, difference, discordant):
    rng, simulations = np.random.default_rng(11), 4000
    b_share, c_share = (discordant + difference) / 2, (discordant - difference) / 2
    draws = rng.multinomial(episodes, [b_share, c_share, 1 - discordant], simulations)
    detections = sum(stats.binomtest(int(b), int(b + c)).pvalue <= 0.05 if b + c else False for b, c, _ in draws)
    assert mcnemar_power(episodes, difference, discordant) == pytest.approx(detections / simulations, abs=0.02)


def test_the_smallest_difference_has_80_percent_power_and_a_smaller_one_has_less():
    for episodes, discordant in ((20, 0.0), (80, 0.3), (100, 0.5)):
        least = smallest_difference(episodes, discordant)
        assert least is not None
        assert mcnemar_power(episodes, least, max(discordant, least)) >= 0.8
        assert mcnemar_power(episodes, least - 2e-4, max(discordant, least - 2e-4)) < 0.8


def test_the_favourable_case_needs_six_discordant_pairs():
    """All discordant pairs favour one side. With six of them, p = 2 · 2^-6 is below 0.05 for the first time."""
    least = smallest_difference(20)
    assert least == pytest.approx(optimize.brentq(lambda share: stats.binom(20, share).sf(5) - 0.8, 0.1, 0.9), abs=1e-4)
    assert smallest_difference(5) is None
    assert smallest_difference(6) is not None


def test_the_smallest_difference_grows_with_the_discordant_share():
    differences = [smallest_difference(40, share) or math.inf for share in (0.0, 0.3, 0.6, 0.9)]
    assert differences == sorted(differences)
    assert differences[0] < differences[-1]
