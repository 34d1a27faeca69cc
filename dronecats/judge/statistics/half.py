"""Where along a factor half of the trials succeed, from a logistic fit with a random intercept a group.

The groups' intercepts are symmetric, so the place where the middle group succeeds half of the time is the place where
half of all groups do: one number, whichever is meant. Its interval is by profile likelihood: every place at which the
best fit is not significantly worse, so it may be open where the trials do not tell (Fieller's case). The limit is that
of F with (1, groups - 1) degrees of freedom, since twenty groups are fewer than chi-square takes for granted.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize, special

from dronecats.judge.statistics.mixed_logit import (
    ALIKE,
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
PLACES = 17  # at which the profile is looked at between the lowest and the highest level
UNLIKE = 1.0  # lost of twice the log likelihood: places are somewhat worse than the best
FLAT = 0.25  # of the places that are somewhat worse so many as good as the best: none is. Of a parabola it is 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfSuccess:
    """Where half of the trials succeed."""

    where: (
        Where  # within the levels; within, but none is best, so sharp is the turn; all lie above half, or below; untold
    )
    value: float | None  # the place, in the factor's unit; None: outside of the levels, or untold
    low: float  # of its interval; -inf: below the lowest level, +inf: above the highest
    high: float  # likewise
    slope: float | None  # of the log odds, for one unit of the factor; None: there is none that is best
    scatter: float | None  # standard deviation of the groups' intercepts, log odds; WIDEST: that or more
    p_slope: float  # that there is none, by likelihood ratio
    p_straight: float | None  # that log odds follow a straight line, against a share a level; None: of two levels
    groups: int
    trials: int


@dataclass(frozen=True, slots=True)
class SuccessCurve:
    """The fitted share of successes along a factor, over all groups."""

    at: Array  # (places,), the factor
    share: Array  # (places,), 0 … 1
    low: Array  # (places,), of its 95 % interval at each place; nan: not told, as no slope or no scatter is the best
    high: Array


def half_success(levels: Sequence[float] | Array, told: Trials, confidence: float = CONFIDENCE) -> HalfSuccess | None:
    """Return where half of the trials succeed; `levels` are of the columns of the trials, each once and in any order.

    None with less than two levels that were tried. Raises ValueError for levels that are no numbers or come twice.
    """
    at, counted = _tried(levels, told)
    if len(at) < 2:
        return None
    groups, trials = int((counted.trials.sum(axis=1) > 0).sum()), int(counted.trials.sum())
    successes = counted.successes.sum()
    if successes in (0, trials):
        where: Where = "below all" if successes == 0 else "above all"
        return HalfSuccess(where=where, value=None, low=math.inf if successes else -math.inf,
                           high=math.inf if successes else -math.inf, slope=None, scatter=None, p_slope=1.0,
                           p_straight=None, groups=groups, trials=trials)  # fmt: skip
    line = _Line(at, counted)
    made, flat = line.best, fit(np.ones((len(at), 1)), counted)
    p_slope = _ratio(made.log_likelihood - flat.log_likelihood, 1)
    gap = _gap(at, counted)
    value = sum(gap) / 2 if gap else line.half
    limit = float(special.fdtri(1, groups - 1, confidence)) if groups > 1 else math.inf
    low, high = line.interval(value, limit)
    peak = covariance(_design(at), counted, made) is not None
    where = "no slope" if (low, high) == (-math.inf, math.inf) else _where(value, at, made)
    if where == "within" and (gap or line.flat(value)):
        where = "between"
    return HalfSuccess(
        where=where,
        value=value if where == "within" else None,
        low=low,
        high=high,
        slope=float(made.coefficients[1]) if peak else None,
        scatter=WIDEST if at_widest(_design(at), counted, made) else made.scatter,
        p_slope=p_slope,
        p_straight=_straight(at, counted, made),
        groups=groups,
        trials=trials,
    )


def success_curve(
    levels: Sequence[float] | Array, told: Trials, places: int = 121, confidence: float = CONFIDENCE
) -> SuccessCurve | None:
    """Return the fitted curve over the levels with its interval (delta method, on the scale of log odds).

    None where there is nothing to fit, or a line parts the outcomes without a mistake.
    """
    at, counted = _tried(levels, told)
    if len(at) < 2 or counted.successes.sum() in (0, counted.trials.sum()):
        return None
    if _gap(at, counted):
        return None
    made = fit(_design(at), counted)
    x = np.linspace(at.min(), at.max(), places)
    shares = share(_design(x) @ made.coefficients, made.scatter)
    spread = covariance(_design(at), counted, made)
    if spread is None:
        return SuccessCurve(x, shares, np.full(places, math.nan), np.full(places, math.nan))
    slopes = np.stack([_moved(x, made, k) for k in range(3)], axis=1)  # of the curve's log odds, (places, 3)
    error = np.sqrt(np.maximum(0.0, np.einsum("ij,jk,ik->i", slopes, spread, slopes)))
    odds, reach = special.logit(shares), float(special.ndtri(0.5 + confidence / 2))
    return SuccessCurve(x, shares, special.expit(odds - reach * error), special.expit(odds + reach * error))


class _Line:
    """The fit of a straight line, and how likely it stays when half of the trials are to succeed at a given place."""

    def __init__(self, at: Array, told: Trials) -> None:
        self._at, self._told = at, told
        self.best = fit(_design(at), told)

    @property
    def half(self) -> float:
        """Where the best line crosses; nan where it does not."""
        intercept, slope = self.best.coefficients
        return float(-intercept / slope) if abs(slope) > 1e-12 else math.nan

    def worse(self, place: float) -> float:
        """Return twice what the log likelihood loses when the line has to cross at a place."""
        begin = MixedLogit(self.best.coefficients[1:], self.best.scatter, 0.0)
        held = fit((self._at - place)[:, None], self._told, begin=begin)
        return max(0.0, 2.0 * (self.best.log_likelihood - held.log_likelihood))

    def interval(self, value: float, limit: float) -> tuple[float, float]:
        """Return the places around a value that are no worse than a limit; infinite beyond the levels."""
        least, most = float(self._at.min()), float(self._at.max())
        places = np.unique(np.append(np.linspace(least, most, PLACES), np.clip(value, least, most)))
        places = places[np.isfinite(places)]
        fine = np.array([self.worse(place) <= limit for place in places])
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
        """Return whether the places around a value are all as good as each other, so that none of them is the best.

        By the profile of the place, and not by how well slope and scatter are told: where these grow together without
        an end, as of episodes that each turn once and for all, the place may be told well all the same.
        """
        alike, unlike = (self._width(value, limit) for limit in (ALIKE, UNLIKE))
        return alike > FLAT * unlike

    def _width(self, value: float, limit: float) -> float:
        """Return how wide the places are, within the levels, that are no worse than a limit."""
        ends = [float(self._at.min()), float(self._at.max())]
        if self.worse(value) >= limit:
            return 0.0
        low, high = (self._edge(end, value, limit) if self.worse(end) > limit else end for end in ends)
        return high - low

    def _edge(self, outside: float, inside: float, limit: float) -> float:
        return float(optimize.brentq(lambda place: self.worse(place) - limit, outside, inside, xtol=1e-4))


def _tried(levels: Sequence[float] | Array, told: Trials) -> tuple[Array, Trials]:
    """Return the levels that were tried, in their order, and the trials at them."""
    at = np.asarray(levels, float)
    if at.shape != told.trials.shape[1:] or not np.isfinite(at).all() or len(np.unique(at)) < len(at):
        raise ValueError("a level wants a number of its own for each column of the trials")
    order = [k for k in np.argsort(at) if told.trials[:, k].any()]
    return at[order], Trials(told.successes[:, order], told.trials[:, order])


def _design(at: Array) -> Array:
    return np.stack([np.ones_like(at), at], axis=1)


def _gap(at: Array, told: Trials) -> tuple[float, float] | None:
    """Return the two levels between which all trials turn from success to failure or back; None: there is no such."""
    shares = told.successes.sum(axis=0) / told.trials.sum(axis=0)
    turns = [k for k in range(1, len(at)) if shares[k] != shares[k - 1]]
    if set(shares) != {0.0, 1.0} or len(turns) != 1:
        return None
    return float(at[turns[0] - 1]), float(at[turns[0]])


def _where(value: float, at: Array, made: MixedLogit) -> Where:
    if not math.isfinite(value):
        return "no slope"
    if at[0] <= value <= at[-1]:
        return "within"
    middle = made.coefficients[0] + made.coefficients[1] * at.mean()
    return "above all" if middle > 0 else "below all"


def _straight(at: Array, told: Trials, made: MixedLogit) -> float | None:
    """Return the p of a straight line against a share of its own for each level."""
    if len(at) < 3:
        return None
    each = fit(np.eye(len(at)), told)
    return _ratio(each.log_likelihood - made.log_likelihood, len(at) - 2)


def _ratio(gain: float, freedom: int) -> float:
    """Return the p of a likelihood ratio."""
    return float(special.chdtrc(freedom, max(0.0, 2.0 * gain)))


def _moved(x: Array, made: MixedLogit, k: int) -> Array:
    """Return how the curve's log odds move with the k-th of (intercept, slope, scatter)."""

    def odds(sign: float) -> Array:
        at = np.append(made.coefficients, made.scatter)
        at[k] += sign * 1e-4
        return np.asarray(special.logit(share(_design(x) @ at[:-1], at[-1])))

    return (odds(1.0) - odds(-1.0)) / 2e-4
