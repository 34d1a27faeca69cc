"""Flights of the same seeds beside one another: a level less the reference, and an entrant less another."""

import itertools
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace

from dronecats.judge.statistics.differences import MeanDifference, mean_difference, share_difference
from dronecats.judge.statistics.paired import holm
from dronecats.study.analysis.levels import MEASURES, LevelStep, level_steps, number
from dronecats.study.analysis.studied import Studied, StudiedFactor, StudiedFlight, by_episode, comparable, others

SUCCESS = "success"
METRICS = (SUCCESS, *(measure.metric for measure in MEASURES))


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """One side less the other, over the pairs that both have."""

    factor: int  # its number
    cell: str
    metric: str  # one of METRICS
    first: str  # an entrant
    second: str  # another, or the same
    at: LevelStep  # the level of the first
    against: LevelStep  # of the second
    pairs: int  # of flights
    difference: MeanDifference  # of shares (-1 … 1), or in the metric's unit; episodes are the unit
    p_holm: float  # the difference's p, corrected for all of one table that are of the same entrants, cell and metric


def between_levels(studied: Studied, factor: int) -> list[PairedDifference]:
    """Return each level of a factor less the factor's reference, of the same entrant, seed and other factors.

    The reference is one level, also where levels are told together; the others of its step are then in no pair.
    """
    steps, against = level_steps(studied.factors[factor]), _alone(studied.factors[factor])
    found = []
    for entrant, cell in studied.lines():
        flown = studied.of(entrant, cell)
        base = [each for each in flown if each.levels[factor] in against.members]
        for metric in METRICS:
            told = []
            for step in (step for step in steps if not against.members & step.members):
                there = [each for each in flown if each.levels[factor] in step.members]
                pairs = pairs_of(there, base, factor)
                told += difference(factor, cell, metric, (entrant, step), (entrant, against), pairs)
            found += _corrected(told)
    return found


def between_entrants(studied: Studied, factor: int) -> list[PairedDifference]:
    """Return each two entrants at each level of a factor, on the same seeds and other factors.

    Of a design of one factor at a time these are at their base, as in `levels.at_levels`.
    """
    steps, found = level_steps(studied.factors[factor]), []
    for (one, other), cell in itertools.product(itertools.combinations(studied.entrants, 2), studied.groups):
        for metric in METRICS:
            told = []
            for step in steps:
                here, there = (
                    [
                        each
                        for each in comparable(studied.of(entrant, cell), factor)
                        if each.levels[factor] in step.members
                    ]
                    for entrant in (one, other)
                )
                told += difference(factor, cell, metric, (one, step), (other, step), pairs_of(here, there, None))
            found += _corrected(told)
    return found


Pair = tuple[StudiedFlight, StudiedFlight]


def _alone(factor: StudiedFactor) -> LevelStep:
    """Return the reference as a step of its own."""
    reference = factor.reference
    return LevelStep(factor.told(reference), None if isinstance(reference, str) else reference, frozenset({reference}))


def pairs_of(one: Sequence[StudiedFlight], other: Sequence[StudiedFlight], factor: int | None) -> list[Pair]:
    """Return the flights of both that share episode, number and the levels of all factors but one."""

    def key(flight: StudiedFlight) -> object:
        return flight.pair, flight.levels if factor is None else others(flight, factor)

    there = {key(each): each for each in other}
    return [(each, there[key(each)]) for each in one if key(each) in there]


def difference(
    factor: int,
    cell: str,
    metric: str,
    one: tuple[str, LevelStep],
    other: tuple[str, LevelStep],
    pairs: Sequence[Pair],
) -> list[PairedDifference]:
    """Return the difference, or nothing where no pair tells it."""
    second = {id(a): b for a, b in pairs}
    if metric == SUCCESS:
        means = [
            statistics.fmean(a.scored.success - second[id(a)].scored.success for a in some)
            for some in by_episode([a for a, _ in pairs]).values()
        ]
        apart = len({id(b) for _, b in pairs})  # one flight beside several of a step is one pair's evidence
        known, count = share_difference(means, max(1.0, apart / max(1, len(means)))), len(pairs)
    else:
        differences, count = [], 0
        for some in by_episode([a for a, _ in pairs]).values():
            told = [
                (number(a.scored.values.get(metric)), number(second[id(a)].scored.values.get(metric))) for a in some
            ]
            both = [a - b for a, b in told if a is not None and b is not None]
            differences += [statistics.fmean(both)] if both else []
            count += len(both)
        known = mean_difference(differences)
    if not known.episodes:
        return []
    return [PairedDifference(factor, cell, metric, one[0], other[0], one[1], other[1], count, known, known.p)]


def _corrected(told: Sequence[PairedDifference]) -> list[PairedDifference]:
    adjusted = holm([each.difference.p for each in told])
    return [replace(each, p_holm=p) for each, p in zip(told, adjusted, strict=True)]
