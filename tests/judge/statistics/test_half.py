"""The level of half success is recovered from simulated data, and is None if the data do not determine it."""

import math

import numpy as np
import pytest
from scipy import special, stats

from dronecats.judge.statistics.half import half_success, success_curve
from dronecats.judge.statistics.mixed_logit import WIDEST, Trials, fit
from tests.judge.statistics.test_mixed_logit import DESIGN, LEVELS, simulated


def of(*columns, flights=10.0, groups=20):
    """Return groups that all have these success shares at the levels."""
    shares = np.tile(np.array(columns), (groups, 1))
    return Trials(shares * flights, np.full(shares.shape, flights))


def test_the_interval_covers_the_true_value_in_95_percent_of_studies():
    """24 studies of 20 episodes with two flights each: at least 21 intervals contain the true value."""
    halves = [half_success(LEVELS, simulated(seed, groups=20)) for seed in range(24)]
    valid = [half for half in halves if half is not None]
    covered = sum(half.low <= 1.2 <= half.high for half in valid)
    assert len(valid) == 24
    assert covered >= 21
    values = [half.value for half in valid if half.value is not None]
    assert np.mean(values) == pytest.approx(1.2, abs=0.1)
    assert np.median([half.high - half.low for half in valid]) < 1.6


def test_the_likelihood_ratio_at_the_interval_ends_equals_the_f_limit():
    """For five groups, the limit of twice the log likelihood ratio is 7.7. For many groups (chi-square) it is 3.8."""
    trials = simulated(1, groups=5, flights=6)
    half = half_success(LEVELS, trials)
    assert half is not None
    best = fit(DESIGN, trials).log_likelihood
    for edge in (half.low, half.high):
        worse = 2.0 * (best - fit((LEVELS - edge)[:, None], trials).log_likelihood)
        assert worse == pytest.approx(stats.f.ppf(0.95, 1, 4), abs=0.05)


def test_more_flights_of_widely_scattered_episodes_hardly_narrow_the_interval():
    """40 flights of an episode are evidence only for that episode: the interval is about as wide as with two."""
    few, many = (half_success(LEVELS, simulated(9, scatter=3.0, groups=30, flights=n)) for n in (2, 40))
    assert few is not None
    assert many is not None
    assert many.high - many.low > 0.5 * (few.high - few.low)


def test_the_linearity_test_accepts_linear_and_rejects_curved_data():
    straight = half_success(LEVELS, simulated(1, groups=60))
    bent = half_success([0.0, 1.0, 2.0, 3.0], of(0.9, 0.2, 0.2, 0.8))
    assert straight is not None
    assert bent is not None
    assert straight.p_straight is not None
    assert straight.p_straight > 0.01
    assert bent.p_straight is not None
    assert bent.p_straight < 1e-6


@pytest.mark.parametrize(
    ("shares", "where", "low", "high"),
    [
        ((1.0, 1.0, 1.0), "above all", math.inf, -math.inf),  # on an unknown side of the levels
        ((0.0, 0.0, 0.0), "below all", math.inf, -math.inf),
        ((0.9, 0.9, 0.9), "above all", math.inf, -math.inf),
        ((0.95, 0.9, 0.8), "above all", math.inf, math.inf),
        ((0.2, 0.1, 0.05), "below all", -math.inf, -math.inf),
        ((0.05, 0.1, 0.2), "below all", math.inf, math.inf),  # the share rises: half success is above all levels
    ],
)
def test_there_is_no_value_outside_the_levels(shares, where, low, high):
    half = half_success([0.0, 1.0, 2.0], of(*shares))
    assert half is not None
    assert (half.where, half.value, half.low, half.high) == (where, None, low, high)


@pytest.mark.parametrize("shift", [10.0, 100.0])
def test_levels_far_from_zero_give_the_same_fit(shift):
    for seed in range(4):
        trials = simulated(seed, groups=20, flights=1)
        near, far = (half_success(np.asarray(LEVELS) + by, trials) for by in (0.0, shift))
        assert near is not None
        assert far is not None
        assert near.where == far.where
        assert (far.low - shift, far.high - shift) == pytest.approx((near.low, near.high), abs=1e-3)
        assert (far.p_slope, far.slope) == pytest.approx((near.p_slope, near.slope), rel=1e-2)


def test_a_curve_over_large_levels_has_the_interval_of_the_same_curve_over_small_ones():
    trials = of(0.4, 0.8)
    small, large = (success_curve([57.6 * by, 921.6 * by], trials) for by in (1.0, 1000.0))
    assert small is not None
    assert large is not None
    assert np.isfinite(large.low).all()
    assert large.low == pytest.approx(small.low)
    assert large.high == pytest.approx(small.high)


def test_without_a_significant_slope_the_interval_reaches_beyond_both_ends():
    trials = of(0.5, 0.75, groups=10, flights=2)
    half = half_success([0.0, 1.0], trials)
    assert half is not None
    assert half.p_slope > 0.05
    assert half.low > half.high or (half.low, half.high) == (-math.inf, math.inf)


def test_perfectly_separated_data_give_an_interval_between_two_levels_but_no_value():
    half = half_success([0.0, 1.0, 2.0, 4.0], of(1.0, 1.0, 0.0, 0.0))
    assert half is not None
    assert (half.where, half.value, half.slope) == ("between", None, None)
    assert 0.9 < half.low <= 1.1
    assert 1.9 <= half.high < 2.1
    assert success_curve([0.0, 1.0, 2.0, 4.0], of(1.0, 1.0, 0.0, 0.0)) is None


def test_an_unbounded_slope_gives_an_interval_but_no_value():
    """Only one level has mixed results, so the likelihood grows with the slope without limit."""
    sharp = Trials(np.ones((8, 4)) * [1, 1, 1, 0] - np.eye(8)[:, :1] * [0, 0, 1, 0], np.ones((8, 4)))
    half = half_success([0.0, 0.5, 1.0, 2.0], sharp)
    assert half is not None
    assert (half.where, half.value, half.slope) == ("between", None, None)
    assert 0.5 < half.low <= half.high < 2.0


def test_a_value_exists_even_if_slope_and_scatter_are_unbounded():
    """Each episode turns from success to failure once, so the likelihood grows with slope and scatter."""
    counts = {(1, 1, 1, 1): 6, (1, 1, 1, 0): 8, (1, 1, 0, 0): 5, (0, 0, 0, 0): 1}
    won = np.array([row for row, times in counts.items() for _ in range(times)], float)
    half = half_success([0.0, 0.3, 0.6, 0.8], Trials(won, np.ones_like(won)))
    assert half is not None
    assert half.where == "within"
    assert half.value is not None
    assert half.value == pytest.approx(0.69, abs=0.01)
    assert 0.5 < half.low < half.value
    assert (half.slope, half.scatter) == (None, WIDEST)  # only the bound of the scatter determines them
    curve = success_curve([0.0, 0.3, 0.6, 0.8], Trials(won, np.ones_like(won)))
    assert curve is not None
    assert np.isnan(curve.low).all()
    assert np.isnan(curve.high).all()
    assert np.interp(half.value, curve.at, curve.share) == pytest.approx(0.5, abs=0.01)


def test_there_is_no_slope_if_the_scatter_is_at_its_bound():
    half = half_success(LEVELS, simulated(1, scatter=20.0, slope=-10.0, groups=200, flights=1))
    assert half is not None
    assert (half.where, half.slope, half.scatter) == ("within", None, WIDEST)
    assert half.low < 1.2 < half.high


def test_without_a_slope_there_is_no_value():
    half = half_success([0.0, 1.0, 2.0], of(0.5, 0.6, 0.5, groups=6, flights=10.0))
    assert half is not None
    assert (half.where, half.value) == ("no slope", None)
    assert half.p_slope > 0.5


def test_data_at_only_one_level_are_not_fitted():
    tried = of(0.5, 0.5)
    once = Trials(tried.successes * [1, 0], tried.trials * [1, 0])
    assert half_success([0.0, 1.0], once) is None
    assert success_curve([0.0, 1.0], once) is None


def test_invalid_levels_are_rejected():
    for levels in ([0.0, 0.0], [0.0], [0.0, math.nan]):
        with pytest.raises(ValueError, match="level"):
            half_success(levels, of(0.5, 0.5))


def test_the_order_of_levels_and_episodes_does_not_matter():
    trials = simulated(3)
    half = half_success(LEVELS, trials)
    rows, columns = np.random.default_rng(3).permutation(40), [3, 1, 5, 0, 2, 4]
    mixed = half_success(LEVELS[columns], Trials(trials.successes[rows][:, columns], trials.trials[rows][:, columns]))
    assert half is not None
    assert mixed is not None
    assert (mixed.value, mixed.low, mixed.high) == pytest.approx((half.value, half.low, half.high), abs=1e-3)


def test_the_value_scales_with_the_unit():
    half, scaled = half_success(LEVELS, simulated(3)), half_success(LEVELS * 1000 + 50, simulated(3))
    assert half is not None
    assert scaled is not None
    assert half.value is not None
    assert scaled.value == pytest.approx(half.value * 1000 + 50, abs=1.0)
    assert (scaled.low, scaled.high) == pytest.approx((half.low * 1000 + 50, half.high * 1000 + 50), abs=2.0)


def test_the_curve_is_one_half_at_the_value_and_its_band_covers_the_true_share():
    half = half_success(LEVELS, simulated(3))
    curve = success_curve(LEVELS, simulated(3), places=2001)
    assert half is not None
    assert curve is not None
    assert half.value is not None
    assert np.interp(half.value, curve.at, curve.share) == pytest.approx(0.5, abs=1e-3)
    assert (curve.low <= curve.share).all()
    assert (curve.share <= curve.high).all()
    truth = np.mean(special.expit(-1.5 * (1.0 - 1.2) + 1.5 * np.random.default_rng(0).normal(size=200_000)))
    covered = 0
    for seed in range(50):
        coarse = success_curve(LEVELS, simulated(seed, groups=25), places=5)  # the second point is at 1 s
        assert coarse is not None
        covered += coarse.low[1] <= truth <= coarse.high[1]
    assert covered >= 44
