"""Where half succeed: recovered from data whose truth is known, and told plainly where the data do not say."""

import math

import numpy as np
import pytest
from scipy import special, stats

from dronecats.judge.statistics.half import half_success, success_curve
from dronecats.judge.statistics.mixed_logit import WIDEST, Trials, fit
from tests.judge.statistics.test_mixed_logit import DESIGN, LEVELS, simulated


def of(*columns, flights=10.0, groups=20):
    """Return groups that all have these shares of successes at the levels."""
    shares = np.tile(np.array(columns), (groups, 1))
    return Trials(shares * flights, np.full(shares.shape, flights))


def test_the_interval_holds_the_truth_as_often_as_it_says():
    """Twenty-four studies of twenty episodes, twice flown: the share that is covered is 95 % but for chance."""
    found = [half_success(LEVELS, simulated(seed, groups=20)) for seed in range(24)]
    told = [each for each in found if each is not None]
    covered = sum(each.low <= 1.2 <= each.high for each in told)
    assert len(told) == 24
    assert covered >= 21
    values = [each.value for each in told if each.value is not None]
    assert np.mean(values) == pytest.approx(1.2, abs=0.1)
    assert np.median([each.high - each.low for each in told]) < 1.6


def test_an_interval_ends_where_the_fit_is_worse_by_the_limit_of_f():
    """Of five groups 7.7 of twice the log likelihood, where chi-square, that of very many, has 3.8."""
    trials = simulated(1, groups=5, flights=6)
    told = half_success(LEVELS, trials)
    assert told is not None
    best = fit(DESIGN, trials).log_likelihood
    for edge in (told.low, told.high):
        worse = 2.0 * (best - fit((LEVELS - edge)[:, None], trials).log_likelihood)
        assert worse == pytest.approx(stats.f.ppf(0.95, 1, 4), abs=0.05)


def test_episodes_that_decide_almost_all_by_themselves_are_no_more_evidence_than_they_are():
    """Forty flights of one episode tell of that one: the interval stays about as wide as for two."""
    few, many = (half_success(LEVELS, simulated(9, scatter=3.0, groups=30, flights=n)) for n in (2, 40))
    assert few is not None
    assert many is not None
    assert many.high - many.low > 0.5 * (few.high - few.low)


def test_a_straight_line_is_not_refused_and_a_bent_one_is():
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
        ((1.0, 1.0, 1.0), "above all", math.inf, math.inf),
        ((0.0, 0.0, 0.0), "below all", -math.inf, -math.inf),
        ((0.95, 0.9, 0.8), "above all", math.inf, math.inf),
        ((0.2, 0.1, 0.05), "below all", -math.inf, -math.inf),
        ((0.05, 0.1, 0.2), "below all", math.inf, math.inf),  # it rises: half would come later
    ],
)
def test_outside_of_the_levels_no_place_is_told(shares, where, low, high):
    told = half_success([0.0, 1.0, 2.0], of(*shares))
    assert told is not None
    assert (told.where, told.value, told.low, told.high) == (where, None, low, high)


def test_what_is_parted_without_a_mistake_lies_between_two_levels():
    told = half_success([0.0, 1.0, 2.0, 4.0], of(1.0, 1.0, 0.0, 0.0))
    assert told is not None
    assert (told.where, told.value, told.slope) == ("between", None, None)
    assert 0.9 < told.low <= 1.1
    assert 1.9 <= told.high < 2.1
    assert success_curve([0.0, 1.0, 2.0, 4.0], of(1.0, 1.0, 0.0, 0.0)) is None


def test_what_turns_as_sharply_as_can_be_has_no_best_place():
    """Only one level is neither all nor nothing: the steeper the line, the likelier, and none is the steepest."""
    sharp = Trials(np.ones((8, 4)) * [1, 1, 1, 0] - np.eye(8)[:, :1] * [0, 0, 1, 0], np.ones((8, 4)))
    told = half_success([0.0, 0.5, 1.0, 2.0], sharp)
    assert told is not None
    assert (told.where, told.value, told.slope) == ("between", None, None)
    assert 0.5 < told.low <= told.high < 2.0


def test_a_place_is_told_though_slope_and_scatter_have_no_end():
    """Each episode turns once and for all, at a level of its own: the steeper and the more scattered, the likelier."""
    counts = {(1, 1, 1, 1): 6, (1, 1, 1, 0): 8, (1, 1, 0, 0): 5, (0, 0, 0, 0): 1}
    won = np.array([row for row, times in counts.items() for _ in range(times)], float)
    told = half_success([0.0, 0.3, 0.6, 0.8], Trials(won, np.ones_like(won)))
    assert told is not None
    assert told.where == "within"
    assert told.value is not None
    assert told.value == pytest.approx(0.69, abs=0.01)
    assert 0.5 < told.low < told.value
    assert (told.slope, told.scatter) == (None, WIDEST)  # what they are is for the bound alone to say
    curve = success_curve([0.0, 0.3, 0.6, 0.8], Trials(won, np.ones_like(won)))
    assert curve is not None
    assert np.isnan(curve.low).all()
    assert np.isnan(curve.high).all()
    assert np.interp(told.value, curve.at, curve.share) == pytest.approx(0.5, abs=0.01)


def test_at_the_widest_scatter_no_slope_is_told_though_the_bound_makes_a_peak_of_it():
    told = half_success(LEVELS, simulated(1, scatter=20.0, slope=-10.0, groups=200, flights=1))
    assert told is not None
    assert (told.where, told.slope, told.scatter) == ("within", None, WIDEST)
    assert told.low < 1.2 < told.high


def test_without_a_slope_there_is_no_place():
    told = half_success([0.0, 1.0, 2.0], of(0.5, 0.6, 0.5, groups=6, flights=10.0))
    assert told is not None
    assert (told.where, told.value) == ("no slope", None)
    assert told.p_slope > 0.5


def test_of_one_level_nothing_is_fitted():
    tried = of(0.5, 0.5)
    once = Trials(tried.successes * [1, 0], tried.trials * [1, 0])
    assert half_success([0.0, 1.0], once) is None
    assert success_curve([0.0, 1.0], once) is None


def test_levels_that_are_none_are_refused():
    for levels in ([0.0, 0.0], [0.0], [0.0, math.nan]):
        with pytest.raises(ValueError, match="level"):
            half_success(levels, of(0.5, 0.5))


def test_neither_the_order_of_levels_nor_that_of_episodes_matters():
    told = simulated(3)
    one = half_success(LEVELS, told)
    rows, columns = np.random.default_rng(3).permutation(40), [3, 1, 5, 0, 2, 4]
    other = half_success(LEVELS[columns], Trials(told.successes[rows][:, columns], told.trials[rows][:, columns]))
    assert one is not None
    assert other is not None
    assert (other.value, other.low, other.high) == pytest.approx((one.value, one.low, one.high), abs=1e-3)


def test_the_unit_goes_through():
    one, other = half_success(LEVELS, simulated(3)), half_success(LEVELS * 1000 + 50, simulated(3))
    assert one is not None
    assert other is not None
    assert one.value is not None
    assert other.value == pytest.approx(one.value * 1000 + 50, abs=1.0)
    assert (other.low, other.high) == pytest.approx((one.low * 1000 + 50, one.high * 1000 + 50), abs=2.0)


def test_the_curve_goes_through_a_half_at_the_place_and_its_band_covers():
    told = half_success(LEVELS, simulated(3))
    curve = success_curve(LEVELS, simulated(3), places=2001)
    assert told is not None
    assert curve is not None
    assert told.value is not None
    assert np.interp(told.value, curve.at, curve.share) == pytest.approx(0.5, abs=1e-3)
    assert (curve.low <= curve.share).all()
    assert (curve.share <= curve.high).all()
    truth = np.mean(special.expit(-1.5 * (1.0 - 1.2) + 1.5 * np.random.default_rng(0).normal(size=200_000)))
    covered = 0
    for seed in range(50):
        each = success_curve(LEVELS, simulated(seed, groups=25), places=5)  # its second place is 1 s
        assert each is not None
        covered += each.low[1] <= truth <= each.high[1]
    assert covered >= 44
