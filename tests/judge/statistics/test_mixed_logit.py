"""Compares the mixed logit with statsmodels, with brute-force quadrature, and with simulated data."""

import numpy as np
import pytest
from scipy import integrate, special, stats

from dronecats.judge.statistics.mixed_logit import (
    WIDEST,
    MixedLogit,
    Trials,
    _likelihood,
    at_widest,
    covariance,
    fit,
    share,
)

LEVELS = np.array([0.0, 0.25, 0.5, 1.0, 2.0, 4.0])
DESIGN = np.stack([np.ones(6), LEVELS], axis=1)


def simulated(seed, half=1.2, slope=-1.5, scatter=1.5, groups=40, flights=2):
    rng = np.random.default_rng(seed)
    odds = slope * (LEVELS - half) + scatter * rng.normal(size=(groups, 1))
    trials = np.full(odds.shape, float(flights))
    return Trials(rng.binomial(flights, special.expit(odds)).astype(float), trials)


def log_likelihood(trials, coefficients, scatter):
    return _likelihood(DESIGN, np.zeros(6), trials, np.append(coefficients, scatter))[0]


def rows(trials):
    """Return the arrays outcomes, levels and groups with one element per trial."""
    triples = [(y, LEVELS[j], g) for (g, j), n in np.ndenumerate(trials.trials.astype(int))
             for y in [1] * int(trials.successes[g, j]) + [0] * (n - int(trials.successes[g, j]))]  # fmt: skip
    return (np.array(column) for column in zip(*triples, strict=True))


def test_the_likelihood_equals_brute_force_quadrature():
    trials = simulated(1, groups=5)

    def group(z, k):
        odds = 1.1 - 0.9 * LEVELS + 2.0 * z
        terms = trials.successes[k] * odds - trials.trials[k] * np.logaddexp(0, odds)
        return np.exp(terms.sum()) * stats.norm.pdf(z)

    brute = sum(np.log(integrate.quad(group, -9, 9, args=(k,), epsabs=1e-14, limit=400)[0]) for k in range(5))
    assert log_likelihood(trials, np.array([1.1, -0.9]), 2.0) == pytest.approx(brute, abs=1e-7)


def test_the_fit_without_scatter_agrees_with_statsmodels_logit():
    import statsmodels.api as sm

    trials = simulated(2, scatter=0.0, groups=30, flights=4)
    made = fit(DESIGN, trials)
    outcomes, levels, _ = rows(trials)
    theirs = sm.Logit(outcomes, sm.add_constant(levels)).fit(disp=0)
    assert log_likelihood(trials, theirs.params, 0.0) == pytest.approx(theirs.llf)
    assert made.log_likelihood >= theirs.llf - 1e-6  # our fit has the scatter as an extra parameter
    if made.scatter < 1e-3:
        assert made.coefficients == pytest.approx(theirs.params, rel=1e-3)


def test_the_slope_is_near_that_of_a_conditional_logit():
    """The conditional logit assumes nothing about the groups, so with enough groups both slopes agree."""
    from statsmodels.discrete.conditional_models import ConditionalLogit

    trials = simulated(3, groups=400)
    outcomes, levels, groups = rows(trials)
    theirs = ConditionalLogit(outcomes, levels[:, None], groups=groups).fit(disp=0)
    assert fit(DESIGN, trials).coefficients[1] == pytest.approx(theirs.params[0], rel=0.05)


def test_the_fit_is_near_statsmodels_bayesian_fit_with_wide_priors():
    import statsmodels.api as sm
    from statsmodels.genmod.bayes_mixed_glm import BinomialBayesMixedGLM

    trials = simulated(4, groups=150, flights=4)
    outcomes, levels, groups = rows(trials)
    design = sm.add_constant(levels)
    one_hot = (groups[:, None] == np.arange(150)).astype(float)
    model = BinomialBayesMixedGLM(outcomes, design, one_hot, np.zeros(150, int), vcp_p=2.0, fe_p=20.0)
    theirs, made = model.fit_vb(), fit(DESIGN, trials)
    assert made.coefficients == pytest.approx(theirs.fe_mean, abs=0.25)
    assert made.scatter == pytest.approx(float(np.exp(theirs.vcp_mean[0])), rel=0.15)


def test_simulated_parameters_are_recovered_with_the_estimated_covariance():
    made = [fit(DESIGN, simulated(seed, groups=60)) for seed in range(60)]
    estimates = np.array([[*model.coefficients, model.scatter] for model in made])
    assert estimates.mean(axis=0) == pytest.approx([1.8, -1.5, 1.5], abs=0.1)
    spread = covariance(DESIGN, simulated(0, groups=60), made[0])
    assert spread is not None
    assert np.sqrt(np.diag(spread)) == pytest.approx(estimates.std(axis=0), rel=0.35)


def test_the_covariance_at_zero_scatter_equals_that_of_statsmodels_logit():
    """With equal groups the scatter is 0, and its covariance is 0 too."""
    import statsmodels.api as sm

    trials = Trials(np.tile([9.0, 7, 6, 5, 3, 1], (12, 1)), np.full((12, 6), 10.0))
    made = fit(DESIGN, trials)
    assert made.scatter == pytest.approx(0.0, abs=1e-3)
    spread = covariance(DESIGN, trials, made)
    assert spread is not None
    outcomes, levels, _ = rows(trials)
    theirs = sm.Logit(outcomes, sm.add_constant(levels)).fit(disp=0).cov_params()
    assert spread[:2, :2] == pytest.approx(theirs, rel=1e-2)
    assert not spread[2].any()
    assert not spread[:, 2].any()


@pytest.mark.parametrize("seed", range(3))
def test_the_fit_does_not_depend_on_order_units_or_coding_of_success(seed):
    trials, made = simulated(seed), fit(DESIGN, simulated(seed))
    order, columns = np.random.default_rng(seed).permutation(40), [3, 1, 5, 0, 2, 4]
    mixed = Trials(trials.successes[order][:, columns], trials.trials[order][:, columns])
    again = fit(DESIGN[columns], mixed)
    assert again.coefficients == pytest.approx(made.coefficients, rel=1e-3)
    in_ms = fit(DESIGN * [1.0, 1000.0], trials)
    assert in_ms.coefficients == pytest.approx(made.coefficients / [1.0, 1000.0], rel=1e-3)
    swapped = fit(DESIGN, Trials(trials.trials - trials.successes, trials.trials))  # failures: all signs change
    assert swapped.coefficients == pytest.approx(-made.coefficients, rel=1e-3, abs=1e-3)


def test_a_group_without_trials_changes_nothing():
    trials = simulated(5)
    more = Trials(np.pad(trials.successes, ((0, 3), (0, 0))), np.pad(trials.trials, ((0, 3), (0, 0))))
    assert fit(DESIGN, more).log_likelihood == pytest.approx(fit(DESIGN, trials).log_likelihood)


def test_an_offset_is_a_fixed_coefficient():
    trials = simulated(6)
    made = fit(DESIGN, trials)
    held = fit(DESIGN[:, :1], trials, offset=made.coefficients[1] * LEVELS)
    assert held.log_likelihood == pytest.approx(made.log_likelihood, abs=1e-5)


def test_perfectly_separated_data_have_no_covariance():
    trials = Trials(np.tile([2.0, 2, 2, 0, 0, 0], (10, 1)), np.full((10, 6), 2.0))
    made = fit(DESIGN, trials)
    assert covariance(DESIGN, trials, made) is None
    assert made.log_likelihood == pytest.approx(0.0, abs=0.01)


def test_a_scatter_beyond_the_bound_is_fitted_at_the_bound_without_covariance():
    trials = simulated(1, scatter=20.0, slope=-10.0, groups=200, flights=1)
    made = fit(DESIGN, trials)
    assert made.scatter == pytest.approx(WIDEST, abs=0.01)
    assert at_widest(DESIGN, trials, made)
    assert covariance(DESIGN, trials, made) is None


def test_an_unbounded_scatter_counts_as_at_its_bound_for_any_start_value():
    """Each group turns from success to failure once, so all scatters above some value are equally likely."""
    won = np.array([[1.0] * k + [0.0] * (6 - k) for k in [3] * 5 + [4] * 8 + [5] * 6 + [6]])
    trials = Trials(won, np.ones_like(won))
    for begin in (8.0, 10.0, 11.5):
        made = fit(DESIGN, trials, begin=MixedLogit(np.array([15.0, -10.0]), begin, 0.0))
        assert at_widest(DESIGN, trials, made)


@pytest.mark.parametrize("seed", range(3))
def test_a_large_scatter_is_not_at_its_bound(seed):
    trials = simulated(seed, scatter=7.0, groups=100, flights=20, slope=-4.0)
    made = fit(DESIGN, trials)
    assert made.scatter > WIDEST / 2.1
    assert not at_widest(DESIGN, trials, made)
    assert covariance(DESIGN, trials, made) is not None


def test_the_share_over_all_groups_is_one_half_at_log_odds_zero():
    for scatter in (0.0, 1.0, 8.0):
        assert share(np.array([0.0]), scatter) == pytest.approx([0.5])
    assert share(np.array([2.0]), 3.0)[0] < special.expit(2.0)


def test_invalid_counts_are_rejected():
    with pytest.raises(ValueError, match="successes"):
        Trials(np.ones((1, 1)), np.zeros((1, 1)))
    with pytest.raises(ValueError, match="column"):
        Trials(np.ones((1, 2)), np.ones((1, 1)))
    with pytest.raises(ValueError, match="design"):
        fit(np.ones((2, 1)), simulated(0))
