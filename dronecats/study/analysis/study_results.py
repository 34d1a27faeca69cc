"""The results of a study: every flight with its levels (values of factors), and shares and means at each level.

The statistical unit is the episode.
"""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from dronecats.judge.metrics.judging import METRICS
from dronecats.judge.metrics.metric import known_values
from dronecats.judge.statistics.differences import KnownMean, known_mean
from dronecats.judge.statistics.shares import ShareEstimate, estimate_share
from dronecats.report.results.collection import ScoredEpisode
from dronecats.study.design import ONE_AT_A_TIME

StudiedLevel = float | str  # value of a factor: a number in the factor's unit, or a word
ALL = "all cells"
MANY = 12  # a factor with more levels than this, as in a Latin hypercube, is reported in groups of levels


@dataclass(frozen=True, slots=True)
class StudiedFactor:
    """A factor that the study varies."""

    name: str  # latency, wind, …
    unit: str  # of the levels; empty for a ratio, a count or words
    levels: tuple[StudiedLevel, ...]  # in the order of study.json
    reference: StudiedLevel  # the level that all others are compared with

    @property
    def numeric(self) -> bool:
        """Whether the levels are numbers, so that a curve of success over level can be fitted."""
        return all(isinstance(level, float) for level in self.levels)

    @property
    def words(self) -> str:
        """The name in words, for example: frame delay."""
        return self.name.replace("_", " ")

    @property
    def title(self) -> str:
        """The name as a heading, with the unit, for example: Latency (s)."""
        name = self.words.replace(".", " ")
        return f"{name[:1].upper()}{name[1:]}{f' ({self.unit})' if self.unit else ''}"

    def label(self, level: StudiedLevel) -> str:
        """Return a level with its unit, for example: 0.5 s."""
        return level if isinstance(level, str) else f"{self.short(level)}{f' {self.unit}' if self.unit else ''}"

    def short(self, level: float) -> str:
        """Return a level without its unit; with three significant digits if the factor has more than MANY levels."""
        return f"{float(f'{level:.3g}') if len(self.levels) > MANY else level:g}"


@dataclass(frozen=True, slots=True)
class StudiedFlight:
    """One flight of one episode under one choice of levels."""

    entrant: str  # label of the pilot or model
    levels: tuple[StudiedLevel, ...]  # one per factor, in the order of the factors
    number: int  # number of the flight; an entrant's flights with the same number have the same seed
    scored: ScoredEpisode

    @property
    def pair(self) -> tuple[str, int]:
        """(episode, number): the key that pairs this flight with flights at other levels and of other entrants."""
        return self.scored.episode, self.number


@dataclass(frozen=True)
class StudyResults:
    name: str
    design: str
    factors: tuple[StudiedFactor, ...]
    entrants: tuple[str, ...]  # labels, in the order in which they were flown
    cells: tuple[str, ...]  # cells (kinds of episode) with flights, in the order of `record.CELLS`
    flights: tuple[StudiedFlight, ...]
    planned: int  # number of flights in the plan; fewer may have been flown
    notes: tuple[str, ...] = ()  # sentences on agents, exclusions and limits of the comparison between entrants

    @cached_property
    def scored(self) -> tuple[StudiedFlight, ...]:
        return tuple(flight for flight in self.flights if flight.scored.scored)

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of flights to report: each cell, preceded by ALL if there are several cells."""
        return (ALL, *self.cells) if len(self.cells) > 1 else self.cells

    def of(self, entrant: str, cell: str = ALL) -> tuple[StudiedFlight, ...]:
        """Return the scored flights of one entrant, in one cell or in all."""
        return tuple(f for f in self.scored if f.entrant == entrant and cell in (ALL, f.scored.cell))

    def lines(self) -> Iterator[tuple[str, str]]:
        """Yield each (entrant, cell or ALL) that has scored flights."""
        for entrant in self.entrants:
            for cell in self.groups:
                if self.of(entrant, cell):
                    yield entrant, cell


def comparable(results: StudyResults, flights: Sequence[StudiedFlight], factor: int) -> list[StudiedFlight]:
    """Return those of `flights` that can be compared over the levels of the factor with this index.

    In a design of one factor at a time, a flight is kept if its levels of the other factors also occur at another level
    of this factor. Without such flights, all are kept. In any other design, all are kept, because the design or chance
    balances the other factors.
    """
    if not results.design.startswith(ONE_AT_A_TIME):
        return list(flights)
    levels_at: dict[tuple[StudiedLevel, ...], set[StudiedLevel]] = {}
    for flight in flights:
        levels_at.setdefault(levels_besides(flight, factor), set()).add(flight.levels[factor])
    varied = [flight for flight in flights if len(levels_at[levels_besides(flight, factor)]) > 1]
    return varied or list(flights)


def levels_besides(flight: StudiedFlight, factor: int) -> tuple[StudiedLevel, ...]:
    """Return the levels of all factors but one."""
    return flight.levels[:factor] + flight.levels[factor + 1 :]


def by_episode(flights: Sequence[StudiedFlight]) -> dict[str, list[StudiedFlight]]:
    """Return the flights of each episode, by its id. Episodes are sorted by id, their flights by number."""
    episodes: dict[str, list[StudiedFlight]] = {}
    for flight in sorted(flights, key=lambda flight: (*flight.pair, str(flight.levels))):
        episodes.setdefault(flight.scored.episode, []).append(flight)
    return episodes


STEPS = 6  # number of groups for a factor with more than MANY levels


# metrics whose means over flights are reported beside the success rate
MEASURES = tuple(METRICS[name] for name in ("ne_m", "dwell_s", "longest_loss_s"))


@dataclass(frozen=True, slots=True)
class LevelStep:
    """A level, or a group of neighbouring levels, that has one row in tables."""

    title: str  # 0.5 s, or 0.2–0.4 s
    at: float | None  # place on an axis: the mean of the levels; None: the levels are words
    members: frozenset[StudiedLevel]


@dataclass(frozen=True, slots=True)
class LevelResult:
    """Success and measures of one entrant at one step, in one cell or in all."""

    entrant: str
    cell: str
    step: LevelStep
    success: ShareEstimate
    measures: tuple[KnownMean, ...]  # in the order of MEASURES
    not_scored: int  # flights that are neither success nor failure


def level_steps(factor: StudiedFactor) -> tuple[LevelStep, ...]:
    """Return the levels of a factor as steps, numbers in rising order; more than MANY levels are grouped."""
    if not factor.numeric:
        return tuple(LevelStep(factor.label(level), None, frozenset({level})) for level in factor.levels)
    levels = sorted(float(level) for level in factor.levels)
    if len(levels) <= MANY:
        return tuple(LevelStep(factor.label(level), level, frozenset({level})) for level in levels)
    steps = []
    for part in range(STEPS):
        members = levels[part * len(levels) // STEPS : (part + 1) * len(levels) // STEPS]
        title = f"{factor.short(members[0])}–{factor.label(members[-1])}"
        steps.append(LevelStep(title, statistics.fmean(members), frozenset(members)))
    return tuple(steps)


def level_results(results: StudyResults, factor: int) -> list[LevelResult]:
    """Return the result of every entrant and cell at each step of a factor, over its `comparable` flights."""
    steps = level_steps(results.factors[factor])
    return [_level_result(results, factor, entrant, cell, step) for entrant, cell in results.lines() for step in steps]


def successes(flights: Sequence[StudiedFlight]) -> ShareEstimate:
    """Return the share of successes with its interval. The episode is the statistical unit."""
    return estimate_share([[flight.scored.success for flight in group] for group in by_episode(flights).values()])


def metric_mean(flights: Sequence[StudiedFlight], metric: str) -> KnownMean:
    """Return the mean of a metric over episodes. An episode's value is the mean of its flights with a known value."""
    means = []
    for group in by_episode(flights).values():
        if values := known_values(flight.scored.values.get(metric) for flight in group):
            means.append(statistics.fmean(values))
    return known_mean(means)


def _level_result(results: StudyResults, factor: int, entrant: str, cell: str, step: LevelStep) -> LevelResult:
    flights = comparable(results, [f for f in results.flights if f.entrant == entrant], factor)
    at_step = [f for f in flights if f.levels[factor] in step.members and cell in (ALL, f.scored.cell)]
    scored = [flight for flight in at_step if flight.scored.scored]
    measures = tuple(metric_mean(scored, measure.name) for measure in MEASURES)
    return LevelResult(entrant, cell, step, successes(scored), measures, len(at_step) - len(scored))
