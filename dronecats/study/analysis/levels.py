"""What flights come to at each level of a factor: shares and means with intervals, episodes as the unit."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from dronecats.judge.metrics.metric import Better, MetricValue
from dronecats.judge.statistics.differences import KnownMean, known_mean
from dronecats.judge.statistics.shares import KnownShare, known_share
from dronecats.study.analysis.studied import (
    ALL,
    MANY,
    Studied,
    StudiedFactor,
    StudiedFlight,
    StudiedLevel,
    by_episode,
    comparable,
)

PARTS = 6  # into which many levels are put


@dataclass(frozen=True, slots=True)
class LevelMeasure:
    """A metric of a flight that is told beside success, as a mean."""

    metric: str  # its name in the registry
    title: str
    unit: str
    better: Better


MEASURES = (
    LevelMeasure("ne_m", "NE", "m", "less"),
    LevelMeasure("dwell_s", "Dwell", "s", "more"),
    LevelMeasure("longest_loss_s", "Longest loss", "s", "less"),
)


@dataclass(frozen=True, slots=True)
class LevelStep:
    """Levels that are told together: one, or of a factor with many some neighbours."""

    title: str  # 0.5 s, or 0.2–0.4 s
    at: float | None  # where it is drawn, the mean of its levels; None: they are words
    members: frozenset[StudiedLevel]


@dataclass(frozen=True, slots=True)
class AtLevel:
    """What the flights of one entrant and one cell, or all, came to at a level."""

    entrant: str
    cell: str
    step: LevelStep
    success: KnownShare
    measures: tuple[KnownMean, ...]  # one of each of MEASURES
    not_scored: int  # flights that are nobody's score


def level_steps(factor: StudiedFactor) -> tuple[LevelStep, ...]:
    """Return a factor's levels as they are told, numbers in their order."""
    if not factor.numeric:
        return tuple(LevelStep(factor.told(level), None, frozenset({level})) for level in factor.levels)
    levels = sorted(float(level) for level in factor.levels)
    if len(levels) <= MANY:
        return tuple(LevelStep(factor.told(level), level, frozenset({level})) for level in levels)
    found = []
    for part in range(PARTS):
        some = levels[part * len(levels) // PARTS : (part + 1) * len(levels) // PARTS]
        title = f"{factor.short(some[0])}–{factor.told(some[-1])}"
        found.append(LevelStep(title, statistics.fmean(some), frozenset(some)))
    return tuple(found)


def at_levels(studied: Studied, factor: int) -> list[AtLevel]:
    """Return what every entrant came to in every cell and all together, at each level of a factor; others pooled."""
    steps = level_steps(studied.factors[factor])
    return [_at(studied, factor, entrant, cell, step) for entrant, cell in studied.lines() for step in steps]


def successes(flights: Sequence[StudiedFlight]) -> KnownShare:
    """Return the share of successes, several flights of one episode being no more evidence than they are."""
    return known_share([[each.scored.success for each in flown] for flown in by_episode(flights).values()])


def mean_of(flights: Sequence[StudiedFlight], metric: str) -> KnownMean:
    """Return the mean over episodes of a metric, each episode's the mean of its flights that have it."""
    means = []
    for flown in by_episode(flights).values():
        told = [number(each.scored.values.get(metric)) for each in flown]
        known = [value for value in told if value is not None]
        means += [statistics.fmean(known)] if known else []
    return known_mean(means)


def number(value: MetricValue) -> float | None:
    """Return a metric's value as a number."""
    return None if value is None else float(value)


def _at(studied: Studied, factor: int, entrant: str, cell: str, step: LevelStep) -> AtLevel:
    flown = comparable([each for each in studied.flights if each.entrant == entrant], factor)
    there = [each for each in flown if each.levels[factor] in step.members and cell in (ALL, each.scored.cell)]
    scored = [each for each in there if each.scored.scored]
    measures = tuple(mean_of(scored, measure.metric) for measure in MEASURES)
    return AtLevel(entrant, cell, step, successes(scored), measures, len(there) - len(scored))
