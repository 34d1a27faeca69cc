"""Fits success with logistic curves: the level at which half of the flights succeed, effects, interactions.

An entrant is a pilot with its settings. A cell is a kind of episode.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, special

from dronecats.judge.statistics.half import HalfSuccess, SuccessCurve, half_success, success_curve
from dronecats.judge.statistics.mixed_logit import Array, MixedLogit, Trials, covariance, fit, share
from dronecats.judge.statistics.shares import CONFIDENCE, ShareEstimate, holm
from dronecats.study.analysis.study_results import (
    LevelStep,
    StudiedFactor,
    StudiedFlight,
    StudiedLevel,
    StudyResults,
    by_episode,
    level_steps,
    levels_besides,
    successes,
)

CHOICES_MAX = 12  # combinations of the other factors' levels; with more of them nothing is fitted


@dataclass(frozen=True, slots=True)
class HalfSuccessFit:
    """The fit of success along a factor, at one combination (choice) of the other factors' levels."""

    factor: int  # index in StudyResults.factors
    entrant: str
    cell: str
    beside: tuple[StudiedLevel, ...]  # levels of the other factors; empty: the fits use only one choice of them
    half: HalfSuccess
    curve: SuccessCurve | None


def half_success_fits(results: StudyResults, factor: int) -> list[HalfSuccessFit]:
    """Return the fits along a factor: one for each entrant, cell, and choice of the other factors' levels.

    The list is empty if the levels are words or there are more than CHOICES_MAX choices.
    """
    if not results.factors[factor].numeric:
        return []
    levels_at: dict[tuple[StudiedLevel, ...], set[StudiedLevel]] = {}
    for flight in results.scored:
        levels_at.setdefault(levels_besides(flight, factor), set()).add(flight.levels[factor])
    choices = [choice for choice, levels in levels_at.items() if len(levels) > 1]
    if len(choices) > CHOICES_MAX:
        return []
    fits = []
    for entrant, cell in results.lines():
        for choice in sorted(choices, key=_in_order):
            flights = [flight for flight in results.of(entrant, cell) if levels_besides(flight, factor) == choice]
            levels = sorted({float(flight.levels[factor]) for flight in flights})
            outcomes = _trials(flights, levels, lambda flight: flight.levels[factor])
            half = half_success(levels, outcomes) if len(levels) > 1 else None
            if half is not None:
                beside = choice if len(choices) > 1 else ()
                curve = success_curve(levels, outcomes)
                fits.append(HalfSuccessFit(factor, entrant, cell, beside, half, curve))
    return fits


def _in_order(levels: tuple[StudiedLevel, ...]) -> list[tuple[float, str]]:
    """Return the sort key of a choice: numbers by size, then words by the alphabet."""
    return [(level, "") if isinstance(level, float) else (float("inf"), level) for level in levels]


@dataclass(frozen=True, slots=True)
class MainEffect:
    """The effect of changing a factor from one level to another, with the other factors held constant."""

    entrant: str
    cell: str
    factor: int  # index in StudyResults.factors
    begin: StudiedLevel  # the lowest level; the first word if the levels are words
    end: StudiedLevel  # the highest level; another word if the levels are words
    log_odds: float | None  # change of the log odds of success from begin to end; None: the likelihood has no peak
    low: float | None  # lower end of the profile-likelihood interval of log_odds; None: no bound
    high: float | None  # upper end; None: no bound
    share_begin: float  # fitted share of successes with the other factors at their mean, 0 … 1
    share_end: float
    p: float  # likelihood ratio test of no effect
    p_holm: float  # Holm's correction over all factors of the entrant and cell
    episodes: int


@dataclass(frozen=True, slots=True)
class HeatMap:
    """Shares of successes over two factors, pooled over the others."""

    entrant: str
    cell: str
    rows: int  # index of the factor of the rows
    columns: int  # index of the factor of the columns
    row_steps: tuple[LevelStep, ...]
    column_steps: tuple[LevelStep, ...]
    shares: tuple[tuple[ShareEstimate, ...], ...]  # by row, then column
    p: float | None  # of the likelihood ratio test of no interaction, in log odds; None: not testable


def main_effects(results: StudyResults) -> list[MainEffect]:
    """Return the effect of each factor for every entrant and cell.

    The list is empty for a study of one factor, and for a design of one factor at a time. In that design, the paired
    differences already compare each level with the base.
    """
    pairs = itertools.combinations(range(len(results.factors)), 2)
    if not any(_crossed(results, a, b) for a, b in pairs):
        return []
    effects = []
    for entrant, cell in results.lines():
        model = _Regression(results.factors, results.of(entrant, cell))
        by_factor = [rows for k in range(len(results.factors)) if (rows := model.effects(entrant, cell, k))]
        adjusted = holm([rows[0].p for rows in by_factor])  # the rows of a factor have the same p
        effects += [replace(row, p_holm=p) for rows, p in zip(by_factor, adjusted, strict=True) for row in rows]
    return effects


def heat_maps(results: StudyResults) -> list[HeatMap]:
    """Return the shares of successes over each pair of factors, for every entrant and cell.

    A pair of factors is left out if in every flight at least one of both is at its base level, as in a design of one
    factor at a time. Then the flights cannot show an interaction.
    """
    steps = [level_steps(factor) for factor in results.factors]
    maps = []
    for down, across in itertools.combinations(range(len(results.factors)), 2):
        if not _crossed(results, down, across):
            continue
        for entrant, cell in results.lines():
            flights = results.of(entrant, cell)
            shares = tuple(
                tuple(
                    successes(
                        [f for f in flights if f.levels[down] in row.members and f.levels[across] in column.members]
                    )
                    for column in steps[across]
                )
                for row in steps[down]
            )
            p = _Regression(results.factors, flights).interaction_p(down, across)
            maps.append(HeatMap(entrant, cell, down, across, steps[down], steps[across], shares, p))
    return maps


def _crossed(results: StudyResults, k: int, m: int) -> bool:
    """Return whether two factors were ever both away from their base levels."""
    points = list(dict.fromkeys((flight.levels[k], flight.levels[m]) for flight in results.scored))
    if not points:
        return False
    base_k, base_m = points[0]  # in a design of one factor at a time, at least one of them is a base level
    along_k, along_m = {y for x, y in points if x != base_k}, {x for x, y in points if y != base_m}
    return len(along_k) > 1 and len(along_m) > 1


class _Regression:
    """A logistic regression of one entrant's successes on all factors, with a random intercept per episode."""

    def __init__(self, factors: tuple[StudiedFactor, ...], flights: tuple[StudiedFlight, ...]) -> None:
        self._factors = factors
        self._choices = sorted({flight.levels for flight in flights}, key=str)
        self._columns = [_columns(factor, [c[k] for c in self._choices]) for k, factor in enumerate(factors)]
        self._trials = _trials(flights, self._choices, lambda flight: flight.levels)
        self._design = np.hstack([np.ones((len(self._choices), 1)), *self._columns])
        self.episodes = self._trials.trials.shape[0]
        self._is_decided = self._trials.successes.sum() in (0, self._trials.trials.sum())
        self._fit = fit(self._design, self._trials)
        self._covariance = None if self._is_decided else covariance(self._design, self._trials, self._fit)

    def effects(self, entrant: str, cell: str, k: int) -> list[MainEffect]:
        """Return the effect of a factor; for words, one effect per word except the first, all with the same p."""
        first = 1 + sum(block.shape[1] for block in self._columns[:k])
        last = first + self._columns[k].shape[1]
        if last == first:
            return []
        without = np.delete(self._design, range(first, last), axis=1)
        gain = self._fit.log_likelihood - fit(without, self._trials).log_likelihood
        p = float(special.chdtrc(last - first, max(0.0, 2 * gain)))
        return [
            self._effect(place, range(first, last), MainEffect(
                entrant=entrant, cell=cell, factor=k, begin=begin, end=end, log_odds=None, low=None, high=None,
                share_begin=math.nan, share_end=math.nan, p=p, p_holm=p, episodes=self.episodes,
            ))
            for place, (begin, end) in zip(range(first, last), self._ends(k), strict=True)
        ]  # fmt: skip

    def interaction_p(self, k: int, m: int) -> float | None:
        """Return the p of the likelihood ratio test of no interaction of two factors; None: not testable."""
        a, b = self._columns[k], self._columns[m]
        products = np.hstack(
            [a[:, [i]] * b[:, [j]] for i in range(a.shape[1]) for j in range(b.shape[1])] or [a[:, :0]]
        )
        more = np.hstack([self._design, products])
        freedom = int(np.linalg.matrix_rank(more) - np.linalg.matrix_rank(self._design))
        if self._is_decided or freedom == 0:
            return None
        gain = fit(more, self._trials).log_likelihood - self._fit.log_likelihood
        return float(special.chdtrc(freedom, max(0.0, 2 * gain)))

    def _ends(self, k: int) -> list[tuple[StudiedLevel, StudiedLevel]]:
        factor = self._factors[k]
        levels_used = {choice[k] for choice in self._choices}
        if factor.numeric:
            levels = sorted(float(level) for level in levels_used)
            return [(levels[0], levels[-1])]
        words = [level for level in factor.levels if level in levels_used]
        return [(words[0], word) for word in words[1:]]

    def _effect(self, place: int, block: range, effect: MainEffect) -> MainEffect:
        """Return an effect with its log odds, its interval and the fitted shares at both ends.

        `place` is the column of the effect, and `block` all columns of its factor. The factor's other columns are 0 at
        both ends.
        """
        coefficient = float(self._fit.coefficients[place])
        middle = self._design.mean(axis=0)
        ends = np.stack([middle, middle])
        least = float(self._design[:, place].min())
        ends[:, block] = 0.0
        ends[:, place] = (least, least + 1.0)  # the values of a column span 1
        begin, end = map(float, share(ends @ self._fit.coefficients, self._fit.scatter))
        effect = replace(effect, share_begin=begin, share_end=end)
        if self._covariance is None:
            return effect
        low, high = (self._edge(place, coefficient, way) for way in (-1.0, 1.0))
        return replace(effect, log_odds=coefficient, low=low, high=high)

    def _edge(self, place: int, best: float, way: float) -> float | None:
        """Return the lower (`way` −1) or upper (+1) end of a coefficient's interval; `best` is its fitted value.

        Beyond the end, the fit is significantly worse. None: no end within 32 of `best`.
        """
        limit = float(special.fdtri(1, max(1, self.episodes - 1), CONFIDENCE))
        without = np.delete(self._design, place, axis=1)
        begin = MixedLogit(np.delete(self._fit.coefficients, place), self._fit.scatter, 0.0)

        def worse(value: float) -> float:
            held = fit(without, self._trials, offset=value * self._design[:, place], begin=begin)
            return 2.0 * (self._fit.log_likelihood - held.log_likelihood) - limit

        far = 1.0
        while worse(best + way * far) < 0:
            far *= 2.0
            if far > 32.0:
                return None
        return float(optimize.brentq(worse, best, best + way * far, xtol=1e-3))


def _columns(factor: StudiedFactor, levels: list[StudiedLevel]) -> Array:
    """Return a factor's design columns: centred numbers with a span of 1, or a column per word except the first."""
    if factor.numeric:
        at = np.array([float(level) for level in levels])
        span = at.max() - at.min()
        return ((at - (at.max() + at.min()) / 2) / span)[:, None] if span else np.zeros((len(levels), 0))
    words = [level for level in factor.levels if level in levels]
    return np.array([[float(level == word) for word in words[1:]] for level in levels]).reshape(len(levels), -1)


def _trials(
    flights: Sequence[StudiedFlight], conditions: Sequence[object], condition: Callable[[StudiedFlight], object]
) -> Trials:
    """Return the outcomes, with a row per episode and a column per condition."""
    episodes = by_episode(flights)
    column = {value: k for k, value in enumerate(conditions)}
    successes, trials = (np.zeros((len(episodes), len(column))) for _ in range(2))
    for line, group in enumerate(episodes.values()):
        for flight in group:
            trials[line, column[condition(flight)]] += 1.0
            successes[line, column[condition(flight)]] += flight.scored.success
    return Trials(successes, trials)
