"""Main effects and interactions, compared with known laws and, for studies without scatter, with statsmodels."""

import numpy as np
import pytest
from scipy import stats

from dronecats.judge.statistics.mixed_logit import Trials, fit
from dronecats.judge.statistics.shares import holm
from dronecats.study.analysis.study_results import StudiedFactor
from dronecats.study.analysis.success_fits import heat_maps, main_effects
from tests.study.analysis.in_memory import a_study, number_factor

LATENCY, WIND = number_factor("latency", 0.0, 1.0, 2.0), number_factor("wind", 0.0, 4.0, 8.0, unit="m/s")
GRID = [(s, v) for s in LATENCY.levels for v in WIND.levels]


def test_main_effects_recover_the_known_law():
    study = a_study([LATENCY, WIND], GRID, lambda s, v: 1.0 - 1.2 * s - 0.1 * v, episodes=60)
    slow, blown = main_effects(study)
    assert (slow.begin, slow.end, blown.begin, blown.end) == (0.0, 2.0, 0.0, 8.0)
    for effect, truth in ((slow, -2.4), (blown, -0.8)):
        assert effect.log_odds == pytest.approx(truth, abs=0.6)
        assert effect.low is not None
        assert effect.high is not None
        assert effect.low < truth < effect.high
    assert slow.p_holm < 1e-6
    assert slow.share_begin > slow.share_end


def test_without_scatter_effects_equal_those_of_statsmodels():
    import statsmodels.api as sm

    study = a_study([LATENCY, WIND], GRID, lambda s, v: 1.0 - 1.2 * s - 0.1 * v, episodes=200, scatter=0.0)
    rows = np.array([[1.0, *flight.levels] for flight in study.flights], float)
    theirs = sm.Logit([flight.scored.success for flight in study.flights], rows).fit(disp=0)
    slow, blown = main_effects(study)
    assert slow.log_odds == pytest.approx(2.0 * theirs.params[1], rel=0.02)
    assert blown.log_odds == pytest.approx(8.0 * theirs.params[2], rel=0.05)
    reach = 1.96 * 2.0 * theirs.bse[1]
    assert slow.low == pytest.approx(2.0 * theirs.params[1] - reach, abs=0.1)
    assert slow.high == pytest.approx(2.0 * theirs.params[1] + reach, abs=0.1)


def test_intervals_end_at_the_f_limit_of_the_likelihood_ratio():
    """With six episodes, twice the log likelihood may fall by 6.6. The chi-square limit, for many episodes, is 3.8."""
    study = a_study([LATENCY, WIND], GRID, lambda s, v: 1.0 - 1.2 * s - 0.1 * v, episodes=6, flights=3)
    by_name = [[f for f in study.flights if f.scored.episode == f"campus-tracking-{k:02}"] for k in range(6)]
    won = np.array(
        [[sum(f.scored.success for f in flights if f.levels == at) for at in GRID] for flights in by_name], float
    )
    trials, grid = Trials(won, np.full_like(won, 3.0)), np.array(GRID)
    rest = np.stack([np.ones(len(GRID)), grid[:, 1] / 8.0], axis=1)
    best = fit(np.column_stack([rest, grid[:, 0] / 2.0]), trials).log_likelihood
    slow, _ = main_effects(study)
    for edge in (slow.low, slow.high):
        assert edge is not None
        worse = 2.0 * (best - fit(rest, trials, offset=edge * grid[:, 0] / 2.0).log_likelihood)
        assert worse == pytest.approx(stats.f.ppf(0.95, 1, 5), abs=0.05)


def test_without_scatter_p_values_and_degrees_of_freedom_equal_those_of_statsmodels():
    """A factor of three words has two columns, and two products with a number. Each test has two degrees of freedom."""
    import statsmodels.api as sm

    policy = StudiedFactor(name="latency_policy", unit="", levels=("fixed", "stall", "slow"), reference="fixed")
    points = [(p, v) for p in policy.levels for v in WIND.levels]
    study = a_study([policy, WIND], points, lambda p, v: 0.5 - 0.4 * (p == "slow"), episodes=40, scatter=0.0)
    won = np.array([flight.scored.success for flight in study.flights], float)
    words = np.array([[flight.levels[0] == "stall", flight.levels[0] == "slow"] for flight in study.flights], float)
    rest = np.array([[1.0, float(flight.levels[1])] for flight in study.flights])

    def likelihood(*columns):
        return sm.Logit(won, np.column_stack(columns)).fit(disp=0).llf

    both, crossed = likelihood(rest, words), likelihood(rest, words, words * rest[:, 1:])
    assert main_effects(study)[0].p == pytest.approx(stats.chi2.sf(2.0 * (both - likelihood(rest)), 2), rel=0.02)
    assert heat_maps(study)[0].p == pytest.approx(stats.chi2.sf(2.0 * (crossed - both), 2), rel=0.02)


def test_shares_of_a_numeric_factor_are_those_at_its_lowest_and_highest_level():
    study = a_study([LATENCY, WIND], GRID, lambda s, v: 2.0 - 2.0 * s, episodes=200, scatter=0.0)
    slow, _ = main_effects(study)
    for share, level in ((slow.share_begin, 0.0), (slow.share_end, 2.0)):
        flown_share = np.mean([flight.scored.success for flight in study.flights if flight.levels[0] == level])
        assert share == pytest.approx(flown_share, abs=0.02)


def test_a_factor_without_an_effect_is_rarely_significant():
    false_positives = 0
    for seed in range(30):
        study = a_study([LATENCY, WIND], GRID, lambda s, v: 0.5 - s, episodes=12, flights=1, seed=seed)
        false_positives += main_effects(study)[1].p <= 0.05
    assert false_positives <= 5  # 1.5 of 30 are expected; six occur once in 200 times


def test_effects_of_words_are_relative_to_the_first_word():
    policy = StudiedFactor(name="latency_policy", unit="", levels=("fixed", "stall", "slow"), reference="fixed")
    points = [(s, p) for s in LATENCY.levels for p in policy.levels]
    hurts = {"fixed": 0.0, "stall": -1.0, "slow": -3.0}
    study = a_study([LATENCY, policy], points, lambda s, p: 1.0 - s + hurts[p], episodes=80)
    _, stall, slow = main_effects(study)
    assert (stall.begin, stall.end, slow.end) == ("fixed", "stall", "slow")
    assert stall.log_odds == pytest.approx(-1.0, abs=0.5)
    assert slow.log_odds == pytest.approx(-3.0, abs=0.8)


def test_fitted_shares_at_each_word_equal_the_observed_shares():
    """The study has no scatter. At the third word, nearly all flights fail."""
    policy = StudiedFactor(name="latency_policy", unit="", levels=("fixed", "stall", "slow"), reference="fixed")
    hurts = {"fixed": 2.0, "stall": 1.0, "slow": -4.0}
    points = [(p, v) for p in policy.levels for v in WIND.levels]
    study = a_study([policy, WIND], points, lambda p, v: hurts[p], episodes=200, scatter=0.0)
    flown_shares = {
        word: np.mean([flight.scored.success for flight in study.flights if flight.levels[0] == word])
        for word in policy.levels
    }
    stall, slow, _ = main_effects(study)
    for effect in (stall, slow):
        assert effect.share_begin == pytest.approx(flown_shares["fixed"], abs=0.02)
        assert effect.share_end == pytest.approx(flown_shares[effect.end], abs=0.02)


def test_the_holm_correction_counts_a_factor_with_several_words_once():
    policy = StudiedFactor(name="latency_policy", unit="", levels=("fixed", "stall", "slow"), reference="fixed")
    points = [(p, v) for p in policy.levels for v in WIND.levels]
    study = a_study([policy, WIND], points, lambda p, v: 1.0 - 0.2 * v - (p == "slow"), episodes=12, flights=1)
    stall, slow, blown = main_effects(study)
    assert stall.p == slow.p
    assert [stall.p_holm, blown.p_holm] == pytest.approx(holm([stall.p, blown.p]))
    assert stall.p_holm == slow.p_holm
    assert max(stall.p, blown.p) < 0.5  # so that the correction has an effect
    assert stall.p_holm + blown.p_holm > stall.p + blown.p


def test_additive_effects_are_distinguished_from_interactions():
    added = a_study([LATENCY, WIND], GRID, lambda s, v: 1.0 - s - 0.1 * v, episodes=40, seed=1)
    worse = a_study([LATENCY, WIND], GRID, lambda s, v: 2.0 - 0.25 * s * v, episodes=40, seed=1)
    [additive], [interacting] = heat_maps(added), heat_maps(worse)
    assert additive.p is not None
    assert interacting.p is not None
    assert additive.p > 0.05
    assert interacting.p < 1e-6
    assert [[share.trials for share in line] for line in additive.shares] == [[80] * 3] * 3


def test_a_factor_that_determines_every_outcome_has_no_finite_effect():
    study = a_study([LATENCY, WIND], GRID, lambda s, v: 50.0 if s < 0.5 else -50.0, episodes=10)
    slow, _ = main_effects(study)
    assert (slow.log_odds, slow.low, slow.high) == (None, None, None)
    assert slow.p < 1e-6
    assert heat_maps(a_study([LATENCY, WIND], GRID, lambda s, v: 99.0, episodes=5))[0].p is None


def test_a_study_of_one_factor_has_no_main_effects_and_no_heat_maps():
    study = a_study([LATENCY], [(level,) for level in LATENCY.levels], lambda s: 1.0 - s)
    assert main_effects(study) == []
    assert heat_maps(study) == []
