"""Fits a logistic regression with a random intercept per group, by the exact marginal likelihood.

Group g succeeds under condition j with probability 1 / (1 + exp(-(X_j b + o_j + s z_g))). X is the design (a row for
each condition), b are the coefficients, o is the offset, s is the scatter of the groups, and z_g is standard normal.
The fit integrates over z by the trapezoid rule over ±7, practically exact for such smooth functions. It maximises the
likelihood with its gradient (McCulloch and Searle, "Generalized, Linear, and Mixed Models", 2001, 8). Coefficients are
bounded, so the fit also ends for perfectly separated outcomes, whose best coefficient is infinite.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

Array = NDArray[np.float64]

REACH = 7.0  # range of z, to either side
STEEPEST = 400.0  # largest absolute value of a coefficient, for columns scaled to at most 1
WIDEST = 12.0  # bound of s; beyond it only the group determines the outcome
EQUAL_LOSS = 0.01  # a fit is as good as the best if its 2 · log likelihood is lower by less than this
LEAST_PEAK = 1e-4  # the log likelihood has a peak if the least eigenvalue of its curvature is at least this


@dataclass(frozen=True, slots=True)
class Trials:
    """The counts of successes and trials of each group under each condition; both may be 0."""

    successes: Array  # (groups, conditions)
    trials: Array  # (groups, conditions)

    def __post_init__(self) -> None:
        """Raise ValueError for invalid counts."""
        if self.successes.shape != self.trials.shape or self.successes.ndim != 2:
            raise ValueError("successes and trials must have the same shape: a row per group, a column per condition")
        if (self.successes < 0).any() or (self.successes > self.trials).any():
            raise ValueError("there are more successes than trials")

    @property
    def most(self) -> int:
        """The largest number of trials of a group."""
        return int(self.trials.sum(axis=1).max(initial=0.0))


@dataclass(frozen=True, slots=True)
class MixedLogit:
    coefficients: Array  # (columns,), log odds per unit of each column
    scatter: float  # s: standard deviation of the groups' intercepts, on the scale of log odds
    log_likelihood: float  # without terms that depend only on the counts


def fit(
    design: Array, trials: Trials, offset: Array | None = None, begin: MixedLogit | None = None, narrowest: float = 0.0
) -> MixedLogit:
    """Return the most likely coefficients and scatter.

    `design`: (conditions, columns), with a column of ones for an intercept. `offset`: (conditions,), added to the log
    odds. `begin`: a fit with the same columns to start from. `narrowest`: lower bound of the scatter. Raises ValueError
    for wrong shapes.
    """
    conditions = trials.trials.shape[1]
    if design.ndim != 2 or design.shape[0] != conditions or (offset is not None and offset.shape != (conditions,)):
        raise ValueError(f"the design must have a row for each of {conditions} conditions")
    scale = _scale(design)
    scaled, moved = design / scale, np.zeros(conditions) if offset is None else offset
    first = np.append(np.zeros(design.shape[1]) if begin is None else begin.coefficients * scale, 1.0)
    if begin is not None:
        first[-1] = max(begin.scatter, 0.1)  # at 0 the gradient in s is 0, so the search would stay there
    first[-1] = max(first[-1], narrowest)

    def loss(at: Array) -> tuple[float, Array]:
        value, slope = _likelihood(scaled, moved, trials, at)
        return -value, -slope

    bounds = [(-STEEPEST, STEEPEST)] * design.shape[1] + [(narrowest, WIDEST)]
    options = {"maxfun": 2000, "ftol": 1e-10, "gtol": 1e-6, "xtol": 1e-8}
    solution = optimize.minimize(loss, first, jac=True, method="TNC", bounds=bounds, options=options)
    best = np.asarray(solution.x)
    return MixedLogit(best[:-1] / scale, float(best[-1]), -float(solution.fun))


def at_widest(design: Array, trials: Trials, fitted: MixedLogit) -> bool:
    """Return whether a fit with the scatter at its bound is as good as this fit.

    In this case the trials determine only the ratio of each coefficient to the scatter; the values depend on WIDEST.
    Always false for a scatter below half of the bound.
    """
    if fitted.scatter < WIDEST / 2:
        return False
    grown = WIDEST / fitted.scatter
    begin = MixedLogit(fitted.coefficients * grown, WIDEST, 0.0)
    widest = fit(design, trials, begin=begin, narrowest=WIDEST)
    return 2.0 * (fitted.log_likelihood - widest.log_likelihood) < EQUAL_LOSS


def covariance(design: Array, trials: Trials, fitted: MixedLogit) -> Array | None:
    """Return the covariance (columns + 1, columns + 1) of coefficients and scatter, from the likelihood's curvature.

    If the scatter is 0, its row and column are 0. None: the likelihood has no peak, as with perfectly separated
    outcomes or a scatter at its bound.
    """
    if at_widest(design, trials, fitted):
        return None
    scale, moved = np.append(_scale(design), 1.0), np.zeros(design.shape[0])
    at, scaled = np.append(fitted.coefficients, fitted.scatter) * scale, design / scale[:-1]
    free = len(at) if fitted.scatter > 1e-3 else len(at) - 1
    curvature = np.zeros((free, free))
    for k in range(free):
        step = np.zeros_like(at)
        step[k] = 1e-4 * max(1.0, abs(at[k]))
        ahead, behind = (_likelihood(scaled, moved, trials, at + sign * step)[1][:free] for sign in (1.0, -1.0))
        curvature[k] = (behind - ahead) / (2 * step[k])
    curvature = (curvature + curvature.T) / 2
    if not np.isfinite(curvature).all() or np.linalg.eigvalsh(curvature).min() < LEAST_PEAK:
        return None
    spread = np.zeros((len(at), len(at)))
    spread[:free, :free] = np.linalg.inv(curvature)
    return np.asarray(spread / np.outer(scale, scale))


def share(log_odds: Array, scatter: float) -> Array:
    """Return the share of successes over all groups. `log_odds`: log odds of the median group."""
    nodes, weights = _nodes(1)
    return np.asarray(special.expit(log_odds[..., None] + scatter * nodes) @ weights)


def _likelihood(design: Array, moved: Array, trials: Trials, at: Array) -> tuple[float, Array]:
    """Return the log likelihood and its gradient in coefficients and scatter."""
    nodes, weights = _nodes(trials.most)
    odds = (design @ at[:-1] + moved)[:, None] + at[-1] * nodes  # (conditions, nodes)
    # (groups, nodes)
    terms = _times(trials.successes, odds) - _times(trials.trials, np.logaddexp(0.0, odds)) + np.log(weights)
    most = terms.max(axis=1, keepdims=True)
    there = np.exp(terms - most)
    totals = there.sum(axis=1, keepdims=True)
    there /= totals  # distribution of each group's z, given the group's outcomes
    # (conditions, nodes)
    pull = _times(trials.successes.T, there) - special.expit(odds) * _times(trials.trials.T, there)
    slope = np.append(design.T @ pull.sum(axis=1), (pull * nodes).sum())
    return float((most + np.log(totals)).sum()), slope


def _times(a: Array, b: Array) -> Array:
    """Return the product of two small matrices in one thread; the threads of BLAS would make it slower."""
    return np.asarray(np.einsum("ij,jk->ik", a, b))


def _scale(design: Array) -> Array:
    """Return the largest absolute value in each column."""
    return np.asarray(np.maximum(np.abs(design).max(axis=0, initial=0.0), 1e-300))


@functools.cache
def _nodes(trials: int) -> tuple[Array, Array]:
    """Return the nodes and weights of the integral over z, fine enough for groups with this number of trials.

    The integrand contains a group's likelihood as a function of s z. Each trial adds at most 1/4 to the curvature of
    its negative log. So its peak is at least as wide as a normal curve with σ = 2 / √trials. Steps of 2 σ in s z
    resolve such a curve; s is at most WIDEST.
    """
    step = min(0.1, 2 * 2 / math.sqrt(max(trials, 1)) / WIDEST)
    nodes = np.linspace(-REACH, REACH, 2 * math.ceil(REACH / step) + 1)
    weights = np.exp(-nodes * nodes / 2)
    return nodes, weights / weights.sum()
