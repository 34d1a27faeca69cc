"""Estimates the place (value of a factor) at which half of the trials succeed.

The model is a logistic fit with a random intercept for each group of trials (for example, an episode). The intercepts
are distributed symmetrically, so the median group and the mean over all groups reach one half at the same place. The
interval is a profile likelihood interval: all places at which the fit is not significantly worse than the best fit. It
may be unbounded, or everything outside of a range (Fieller's cases). The limit of significance is a quantile of F with
(1, groups - 1) degrees of freedom, because the chi-square quantile is too small for few groups, for example twenty.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import optimize, special

from dronecats.judge.statistics.mixed_logit import (
    EQUAL_LOSS,
    WIDEST,
    Array,
    MixedLogit,
    Trials,
    at_widest,
    covariance,
    fit,
    share,
)
from dronecats.judge.statistics.shares import CONFIDENCE

Where = Literal["within", "between", "above all", "below all", "no slope"]
PLACES = 17  # number of places, from the lowest to the highest level, at which the profile is computed
# a place is noticeably worse than the best if its 2 · log likelihood is lower by more than this
NOTICEABLE_LOSS = 1.0
# The profile is flat (no place is best) if the range of places within EQUAL_LOSS is wider than this share of the range
# within NOTICEABLE_LOSS. For a parabola the share is 0.1.
FLAT_WIDTH_RATIO = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSuccess:
    where: Where  # "between": within the levels, but many places are equally good
    value: float | None  # the place, in the factor's unit; None: outside of the levels, or unknown
    # Ends of the interval; -inf: below the lowest level, +inf: above the highest. If low > high, the interval has the
    # places from `low` up and those up to `high`: no slope is compatible with the trials, so the side is unknown.
    low: float
    high: float
    slope: float | None  # slope of the log odds per unit of the factor; None: the likelihood has no peak
    scatter: float | None  # standard deviation of the groups' intercepts, log odds; WIDEST means at least WIDEST
    p_slope: float  # p-value of the likelihood ratio test of no slope
    p_straight: float | None  # p-value of the test of linear log odds against a share per level; None: two levels
    groups: int
    trials: int


@dataclass(frozen=True, slots=True)
class SuccessCurve:
    """The fitted share of successes along a factor, over all groups."""

    at: Array  # (places,), values of the factor
    share: Array  # (places,), 0 … 1
    low: Array  # (places,), lower end of the 95 % interval of `share`; nan: the likelihood has no peak
    high: Array  # (places,), upper end


def half_success(levels: Sequence[float] | Array, trials: Trials) -> HalfSuccess | None:
    """Return the place at which half of the trials succeed.

    `levels` has the factor's value for each column of `trials`. None if fewer than two levels have trials. Raises
    ValueError for duplicate levels or levels that are not numbers.
    """
    at, counted = _tried(levels, trials)
    if len(at) < 2:
        return None
    middle, unit = _scale(at)
    half = _half_success((at - middle) / unit, counted)
    value = None if half.value is None else middle + unit * half.value
    slope = None if half.slope is None else half.slope / unit
    return replace(half, value=value, low=middle + unit * half.low, high=middle + unit * half.high, slope=slope)


def _half_success(at: Array, counted: Trials) -> HalfSuccess:
    """Return the place of half success for levels within -1 … 1."""
    groups, count = int((counted.trials.sum(axis=1) > 0).sum()), int(counted.trials.sum())
    successes = counted.successes.sum()
    if successes in (0, count):
        where: Where = "below all" if successes == 0 else "above all"
        return HalfSuccess(where=where, value=None, low=math.inf, high=-math.inf, slope=None, scatter=None,
                           p_slope=1.0, p_straight=None, groups=groups, trials=count)  # fmt: skip
    line = _Line(at, counted)
    fitted, flat = line.best, fit(np.ones((len(at), 1)), counted)
    p_slope = _ratio(fitted.log_likelihood - flat.log_likelihood, 1)
    gap = _gap(at, counted)
    value = sum(gap) / 2 if gap else line.half
    limit = float(special.fdtri(1, groups - 1, CONFIDENCE)) if groups > 1 else math.inf
    can_be_flat = 2.0 * (fitted.log_likelihood - flat.log_likelihood) <= limit
    low, high = line.interval(value, limit, can_be_flat=can_be_flat)
    peak = covariance(_design(at), counted, fitted) is not None
    where = "no slope" if (low, high) == (-math.inf, math.inf) else _where(value, at, fitted)
    if where == "within" and (gap or line.flat(value)):
        where = "between"
    return HalfSuccess(
        where=where,
        value=value if where == "within" else None,
        low=low,
        high=high,
        slope=float(fitted.coefficients[1]) if peak else None,
        scatter=WIDEST if at_widest(_design(at), counted, fitted) else fitted.scatter,
        p_slope=p_slope,
        p_straight=_straight(at, counted, fitted),
        groups=groups,
        trials=count,
    )


def success_curve(levels: Sequence[float] | Array, trials: Trials, places: int = 121) -> SuccessCurve | None:
    """Return the fitted curve over the levels with its interval (delta method, on the scale of log odds).

    None if fewer than two levels have trials, all trials have one outcome, or two levels separate the outcomes.
    """
    at, counted = _tried(levels, trials)
    if len(at) < 2 or counted.successes.sum() in (0, counted.trials.sum()):
        return None
    if _gap(at, counted):
        return None
    middle, unit = _scale(at)
    at = (at - middle) / unit
    fitted = fit(_design(at), counted)
    x = np.linspace(-1.0, 1.0, places)
    shares = share(_design(x) @ fitted.coefficients, fitted.scatter)
    spread = covariance(_design(at), counted, fitted)
    if spread is None:
        return SuccessCurve(middle + unit * x, shares, np.full(places, math.nan), np.full(places, math.nan))
    # derivatives of the curve's log odds, (places, 3)
    slopes = np.stack([_curve_derivative(x, fitted, k) for k in range(3)], axis=1)
    error = np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slopes, spread, slopes)))
    odds, reach = special.logit(shares), float(special.ndtri(0.5 + CONFIDENCE / 2))
    low, high = special.expit(odds - reach * error), special.expit(odds + reach * error)
    return SuccessCurve(middle + unit * x, shares, low, high)


class _Line:
    """The fit of linear log odds, and its profile likelihood over the place at which half of the trials succeed."""

    def __init__(self, at: Array, trials: Trials) -> None:
        self._at, self._trials = at, trials
        self.best = fit(_design(at), trials)

    @property
    def half(self) -> float:
        """The place at which the best line crosses one half; nan: the line is flat."""
        intercept, slope = self.best.coefficients
        return float(-intercept / slope) if abs(slope) > 1e-12 else math.nan

    def worse(self, place: float) -> float:
        """Return twice the loss of log likelihood if the line must cross one half at `place`."""
        begin = MixedLogit(self.best.coefficients[1:], self.best.scatter, 0.0)
        held = fit((self._at - place)[:, None], self._trials, begin=begin)
        return max(0.0, 2.0 * (self.best.log_likelihood - held.log_likelihood))

    def interval(self, value: float, limit: float, *, can_be_flat: bool) -> tuple[float, float]:
        """Return the interval of places around `value` that lose at most `limit`. `can_be_flat`: so does a flat line.

        An end is infinite if the interval reaches the lowest or highest level. Both ends are the same infinity if every
        place within the levels loses more. A flat line is the limit of lines that cross one half far below or far above
        the levels, so if it is possible, both sides are: then low > high, unless all places are possible.
        """
        least, most = float(self._at.min()), float(self._at.max())
        places = np.unique(np.append(np.linspace(least, most, PLACES), np.clip(value, least, most)))
        places = places[np.isfinite(places)]
        fine = np.array([self.worse(place) <= limit for place in places])
        if can_be_flat:
            if fine.all():
                return -math.inf, math.inf
            first, last = np.flatnonzero(~fine)[[0, -1]]
            high = -math.inf if first == 0 else self._edge(places[first], places[first - 1], limit)
            low = math.inf if last == len(places) - 1 else self._edge(places[last], places[last + 1], limit)
            return low, high
        if not fine.any():
            beyond = math.inf if value > most else -math.inf
            return beyond, beyond
        middle = value if math.isfinite(value) else float(places[fine].mean())
        k = int(np.argmin(np.where(fine, np.abs(places - middle), np.inf)))
        first = last = k
        while first > 0 and fine[first - 1]:
            first -= 1
        while last < len(places) - 1 and fine[last + 1]:
            last += 1
        low = -math.inf if first == 0 else self._edge(places[first - 1], places[first], limit)
        high = math.inf if last == len(places) - 1 else self._edge(places[last + 1], places[last], limit)
        return low, high

    def flat(self, value: float) -> bool:
        """Return whether the places around `value` are equally good, so that none of them is the best.

        The test uses the profile of the place, not slope and scatter. If each group turns once from failure to
        success, slope and scatter grow without limit, but the place may still be well determined.
        """
        equal, unequal = (self._width(value, limit) for limit in (EQUAL_LOSS, NOTICEABLE_LOSS))
        return equal > FLAT_WIDTH_RATIO * unequal

    def _width(self, value: float, limit: float) -> float:
        """Return the width of the range of places, within the levels, that lose at most `limit`."""
        ends = [float(self._at.min()), float(self._at.max())]
        if self.worse(value) >= limit:
            return 0.0
        low, high = (self._edge(end, value, limit) if self.worse(end) > limit else end for end in ends)
        return high - low

    def _edge(self, outside: float, inside: float, limit: float) -> float:
        return float(optimize.brentq(lambda place: self.worse(place) - limit, outside, inside, xtol=1e-6))


def _tried(levels: Sequence[float] | Array, trials: Trials) -> tuple[Array, Trials]:
    """Return the levels that have trials, in rising order, and their trials."""
    at = np.asarray(levels, float)
    if at.shape != trials.trials.shape[1:] or not np.isfinite(at).all() or len(np.unique(at)) < len(at):
        raise ValueError("levels must have one number for each column of the trials")
    order = [k for k in np.argsort(at) if trials.trials[:, k].any()]
    return at[order], Trials(trials.successes[:, order], trials.trials[:, order])


def _scale(at: Array) -> tuple[float, float]:
    """Return the middle and half the range of rising levels. The fit stops early if the levels are far from 0."""
    return float(at[0] + at[-1]) / 2, float(at[-1] - at[0]) / 2


def _design(at: Array) -> Array:
    return np.stack([np.ones_like(at), at], axis=1)


def _gap(at: Array, trials: Trials) -> tuple[float, float] | None:
    """Return the two levels that separate all failures from all successes; None: no such levels."""
    shares = trials.successes.sum(axis=0) / trials.trials.sum(axis=0)
    turns = [k for k in range(1, len(at)) if shares[k] != shares[k - 1]]
    if set(shares) != {0.0, 1.0} or len(turns) != 1:
        return None
    return float(at[turns[0] - 1]), float(at[turns[0]])


def _where(value: float, at: Array, fitted: MixedLogit) -> Where:
    if at[0] <= value <= at[-1]:
        return "within"
    middle = fitted.coefficients[0] + fitted.coefficients[1] * at.mean()
    return "above all" if middle > 0 else "below all"


def _straight(at: Array, trials: Trials, fitted: MixedLogit) -> float | None:
    """Return the p-value of the test of linear log odds against a separate share for each level."""
    if len(at) < 3:
        return None
    saturated = fit(np.eye(len(at)), trials)
    return _ratio(saturated.log_likelihood - fitted.log_likelihood, len(at) - 2)


def _ratio(gain: float, freedom: int) -> float:
    """Return the p-value of a likelihood ratio test; `gain` is the gain in log likelihood."""
    return float(special.chdtrc(freedom, max(0.0, 2.0 * gain)))


def _curve_derivative(x: Array, fitted: MixedLogit, k: int) -> Array:
    """Return the derivative of the curve's log odds with respect to the k-th of (intercept, slope, scatter)."""

    def odds(sign: float) -> Array:
        at = np.append(fitted.coefficients, fitted.scatter)
        at[k] += sign * 1e-4
        return np.asarray(special.logit(share(_design(x) @ at[:-1], at[-1])))

    return (odds(1.0) - odds(-1.0)) / 2e-4
