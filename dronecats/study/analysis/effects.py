"""What each of several factors does by itself, and each two of them together: a mixed logit over all of them."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, special

from dronecats.judge.statistics.mixed_logit import Array, MixedLogit, Trials, covariance, fit, share
from dronecats.judge.statistics.paired import holm
from dronecats.judge.statistics.shares import CONFIDENCE, KnownShare
from dronecats.study.analysis.levels import LevelStep, level_steps, successes
from dronecats.study.analysis.studied import Studied, StudiedFactor, StudiedFlight, StudiedLevel, by_episode


@dataclass(frozen=True, slots=True)
class MainEffect:
    """What a factor does while the others stay: from one level to another."""

    entrant: str
    cell: str
    factor: int
    begin: StudiedLevel  # the lowest level, of words the first
    end: StudiedLevel  # the highest, of words this one
    log_odds: float | None  # of success, at the end less at the beginning; None: no number is the best
    low: float | None  # of its interval, by profile likelihood; None: not told
    high: float | None
    share_begin: float  # of successes there, fitted, the other factors at their middle, 0 … 1
    share_end: float
    p: float  # likelihood ratio: that the factor does nothing
    p_holm: float  # for all factors of the entrant and cell
    episodes: int


@dataclass(frozen=True, slots=True)
class HeatMap:
    """Shares of successes over two factors, whatever the others are at."""

    entrant: str
    cell: str
    rows: int  # number of the factor downwards
    columns: int  # of that to the right
    row_steps: tuple[LevelStep, ...]
    column_steps: tuple[LevelStep, ...]
    shares: tuple[tuple[KnownShare, ...], ...]  # by row, then column
    p: float | None  # likelihood ratio: that the two only add up, as log odds do; None: it cannot be told


def main_effects(studied: Studied) -> list[MainEffect]:
    """Return each factor's effect for every entrant and cell; nothing of a study of one factor.

    Nor of one factor at a time: there each has its pairs with the base, and lines through all levels at once would be
    bent by one another, since all go through that one point.
    """
    pairs = itertools.combinations(range(len(studied.factors)), 2)
    if not any(_crossed(studied, one, other) for one, other in pairs):
        return []
    found = []
    for entrant, cell in studied.lines():
        model = _Model(studied.factors, studied.of(entrant, cell))
        by_factor = [told for k in range(len(studied.factors)) if (told := model.effects(entrant, cell, k))]
        adjusted = holm([told[0].p for told in by_factor])  # the words of a factor share one test
        found += [replace(each, p_holm=p) for told, p in zip(by_factor, adjusted, strict=True) for each in told]
    return found


def heat_maps(studied: Studied) -> list[HeatMap]:
    """Return the shares over each two factors, for every entrant and cell.

    Nothing of two of which one always is at its base, as in a design of one factor at a time: nothing tells how they
    go together.
    """
    steps = [level_steps(factor) for factor in studied.factors]
    found = []
    for one, other in itertools.combinations(range(len(studied.factors)), 2):
        if not _crossed(studied, one, other):
            continue
        for entrant, cell in studied.lines():
            flown = studied.of(entrant, cell)
            shares = tuple(
                tuple(
                    successes([f for f in flown if f.levels[one] in row.members and f.levels[other] in column.members])
                    for column in steps[other]
                )
                for row in steps[one]
            )
            p = _Model(studied.factors, flown).together(one, other)
            found.append(HeatMap(entrant, cell, one, other, steps[one], steps[other], shares, p))
    return found


def _crossed(studied: Studied, one: int, other: int) -> bool:
    """Return whether two factors were ever both away from one base: whether no base has each alone leave it."""
    flown = list(dict.fromkeys((each.levels[one], each.levels[other]) for each in studied.scored))
    if not flown:
        return False
    a, b = flown[0]  # on the way along one of the two, so that the base has its level of the other, or both
    along_one, along_other = {y for x, y in flown if x != a}, {x for x, y in flown if y != b}
    return len(along_one) > 1 and len(along_other) > 1


class _Model:
    """The mixed logit of one entrant's flights over all factors."""

    def __init__(self, factors: tuple[StudiedFactor, ...], flights: tuple[StudiedFlight, ...]) -> None:
        self._factors = factors
        self._choices = sorted({each.levels for each in flights}, key=str)
        self._columns = [_columns(factor, [c[k] for c in self._choices]) for k, factor in enumerate(factors)]
        self._told = _trials(flights, self._choices)
        self._design = np.hstack([np.ones((len(self._choices), 1)), *self._columns])
        self.episodes = self._told.trials.shape[0]
        self._decided = self._told.successes.sum() in (0, self._told.trials.sum())
        self._made = fit(self._design, self._told)
        self._peak = None if self._decided else covariance(self._design, self._told, self._made)

    def effects(self, entrant: str, cell: str, k: int) -> list[MainEffect]:
        """Return the effect of a factor; of words one for each but the first, with the p of all of them."""
        first = 1 + sum(block.shape[1] for block in self._columns[:k])
        last = first + self._columns[k].shape[1]
        if last == first:
            return []
        without = np.delete(self._design, range(first, last), axis=1)
        gain = self._made.log_likelihood - fit(without, self._told).log_likelihood
        p = float(special.chdtrc(last - first, max(0.0, 2 * gain)))
        return [
            self._effect(place, range(first, last), MainEffect(
                entrant=entrant, cell=cell, factor=k, begin=begin, end=end, log_odds=None, low=None, high=None,
                share_begin=math.nan, share_end=math.nan, p=p, p_holm=p, episodes=self.episodes,
            ))
            for place, (begin, end) in zip(range(first, last), self._ends(k), strict=True)
        ]  # fmt: skip

    def together(self, one: int, other: int) -> float | None:
        """Return the p of the two factors' products having no part."""
        a, b = self._columns[one], self._columns[other]
        products = np.hstack(
            [a[:, [i]] * b[:, [j]] for i in range(a.shape[1]) for j in range(b.shape[1])] or [a[:, :0]]
        )
        more = np.hstack([self._design, products])
        freedom = int(np.linalg.matrix_rank(more) - np.linalg.matrix_rank(self._design))
        if self._decided or freedom == 0:
            return None
        gain = fit(more, self._told).log_likelihood - self._made.log_likelihood
        return float(special.chdtrc(freedom, max(0.0, 2 * gain)))

    def _ends(self, k: int) -> list[tuple[StudiedLevel, StudiedLevel]]:
        factor = self._factors[k]
        flown = {choice[k] for choice in self._choices}
        if factor.numeric:
            levels = sorted(float(level) for level in flown)
            return [(levels[0], levels[-1])]
        words = [level for level in factor.levels if level in flown]
        return [(words[0], word) for word in words[1:]]

    def _effect(self, place: int, block: range, told: MainEffect) -> MainEffect:
        """Return an effect with its odds ratio, its interval and the fitted shares at both ends.

        `place` is its column, `block` all columns of its factor: of words the others are at 0 at both ends.
        """
        coefficient = float(self._made.coefficients[place])
        middle = self._design.mean(axis=0)
        ends = np.stack([middle, middle])
        least = float(self._design[:, place].min())
        ends[:, block] = 0.0
        ends[:, place] = (least, least + 1.0)  # a column spans 1
        begin, end = map(float, share(ends @ self._made.coefficients, self._made.scatter))
        told = replace(told, share_begin=begin, share_end=end)
        if self._peak is None:
            return told
        low, high = (self._edge(place, coefficient, way) for way in (-1.0, 1.0))
        return replace(
            told,
            log_odds=coefficient,
            low=low,
            high=high,
        )

    def _edge(self, place: int, best: float, way: float) -> float | None:
        """Return how far a coefficient goes before the fit is significantly worse; None: as far as one likes."""
        limit = float(special.fdtri(1, max(1, self.episodes - 1), CONFIDENCE))
        without = np.delete(self._design, place, axis=1)
        begin = MixedLogit(np.delete(self._made.coefficients, place), self._made.scatter, 0.0)

        def worse(value: float) -> float:
            held = fit(without, self._told, offset=value * self._design[:, place], begin=begin)
            return 2.0 * (self._made.log_likelihood - held.log_likelihood) - limit

        far = 1.0
        while worse(best + way * far) < 0:
            far *= 2.0
            if far > 32.0:
                return None
        return float(optimize.brentq(worse, best, best + way * far, xtol=1e-3))


def _columns(factor: StudiedFactor, levels: list[StudiedLevel]) -> Array:
    """Return a factor's part of the design: numbers from their middle, over a span of 1; of words one column each."""
    if factor.numeric:
        at = np.array([float(level) for level in levels])
        span = at.max() - at.min()
        return ((at - (at.max() + at.min()) / 2) / span)[:, None] if span else np.zeros((len(levels), 0))
    words = [level for level in factor.levels if level in levels]
    return np.array([[float(level == word) for word in words[1:]] for level in levels]).reshape(len(levels), -1)


def _trials(flights: tuple[StudiedFlight, ...], choices: list[tuple[StudiedLevel, ...]]) -> Trials:
    episodes = by_episode(flights)
    column = {choice: k for k, choice in enumerate(choices)}
    won, flown = (np.zeros((len(episodes), len(choices))) for _ in range(2))
    for line, some in enumerate(episodes.values()):
        for each in some:
            flown[line, column[each.levels]] += 1.0
            won[line, column[each.levels]] += each.scored.success
    return Trials(won, flown)
