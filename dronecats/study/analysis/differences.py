"""Computes differences of flights in pairs (equal seeds): factor level minus reference level, or pilot minus pilot."""

import itertools
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from dronecats.judge.statistics.differences import MeanDifference, mean_difference, share_difference
from dronecats.judge.statistics.shares import ShareEstimate, holm
from dronecats.study.analysis.study_results import (
    MEASURES,
    LevelStep,
    StudiedFactor,
    StudiedFlight,
    StudiedLevel,
    StudyResults,
    by_episode,
    comparable,
    level_steps,
    levels_besides,
    successes,
)

SUCCESS, NE = "success", "ne_m"
METRICS = (SUCCESS, *(measure.name for measure in MEASURES))
POINTS_MAX = 100  # a study with more points, such as a Latin hypercube, gets no table of points
UNDISTURBED = "the usual levels"  # title of the point with the usual (most frequent) level of every factor

Parts = Mapping[LevelStep, Sequence[StudiedFlight]]  # the flights of one entrant and cell, by level or point
Pair = tuple[StudiedFlight, StudiedFlight]
StudyPoint = tuple[StudiedLevel, ...]  # a point of the design: one level of every factor


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """The difference in a metric between two sides, the first minus the second, over their pairs of flights."""

    cell: str
    metric: str  # one of METRICS
    first: str  # entrant (pilot) of the first side
    second: str  # entrant of the second side; may be the same
    at: LevelStep  # the level of the first side, or the point of both sides
    against: LevelStep  # the level of the second side
    pairs: int  # number of pairs of flights
    shares: tuple[ShareEstimate, ...]  # share of successes of the first and of the second side; empty for other metrics
    difference: MeanDifference  # of shares (-1 … 1), or in the metric's unit; the statistical unit is the episode
    p_holm: float  # p with Holm's correction over the table's rows of the same entrants, cell and metric


def between_levels(results: StudyResults, factor: int) -> list[PairedDifference]:
    """Return the difference of each level of a factor from its reference, for the same entrant, seed and other factors.

    If a factor has many levels, `level_steps` groups them. The reference is still a single level, and the other levels
    of its group are in no pair.
    """
    studied, differences = results.factors[factor], []
    level = studied.reference
    reference = LevelStep(studied.label(level), None if isinstance(level, str) else level, frozenset({level}))
    for entrant, cell in results.lines():
        sides = {
            step: _Side(entrant, step, [f for f in results.of(entrant, cell) if f.levels[factor] in step.members])
            for step in (reference, *level_steps(studied))
        }
        base = sides[reference]
        others = [(side, base) for step, side in sides.items() if level not in step.members]
        differences += _differences(cell, METRICS, others, factor)
    return differences


def between_entrants(results: StudyResults, factor: int) -> list[PairedDifference]:
    """Return the difference of each pair of entrants at each level of a factor, for the same seed and other factors.

    Only `comparable` flights are used, as in `level_results`.
    """

    def parts(flights: Sequence[StudiedFlight]) -> Parts:
        kept = comparable(results, flights, factor)
        return {
            step: [flight for flight in kept if flight.levels[factor] in step.members]
            for step in level_steps(results.factors[factor])
        }

    return _between_entrants(results, METRICS, parts)


def point_differences(results: StudyResults) -> list[PairedDifference]:
    """Return the difference in success and NE (navigation error) of each pair of entrants at each point of the design.

    The title of a point has the levels that differ from the usual ones. The list is empty for a study of one factor, or
    with more than POINTS_MAX points. A study that varies only the entrant has one point.
    """
    count = len({flight.levels for flight in results.scored})
    if len(results.factors) == 1 or not 0 < count <= POINTS_MAX:
        return []
    points = _ordered_points(results)
    usual = _usual_levels(results.factors, points)
    titles = {point: point_title(results.factors, point, usual) for point in points}

    def parts(flights: Sequence[StudiedFlight]) -> Parts:
        return {
            LevelStep(title, None, frozenset(point)): [flight for flight in flights if flight.levels == point]
            for point, title in titles.items()
        }

    return _between_entrants(results, (SUCCESS, NE), parts)


def pooled_differences(results: StudyResults, points: Sequence[PairedDifference]) -> list[PairedDifference]:
    """Return the difference in success of each pair of entrants, pooled over all points; empty without `points`.

    There is one difference per pair and cell. The statistical unit is the episode, with its mean over all points.
    """
    step = LevelStep("all", None, frozenset())
    return _between_entrants(results, (SUCCESS,), lambda flights: {step: flights}) if points else []


@dataclass(frozen=True, slots=True)
class _Side:
    """One side of a comparison."""

    entrant: str
    step: LevelStep
    flights: Sequence[StudiedFlight]


def _between_entrants(
    results: StudyResults, metrics: Sequence[str], parts: Callable[[Sequence[StudiedFlight]], Parts]
) -> list[PairedDifference]:
    """Return the differences of each pair of entrants in each cell. `parts` divides an entrant's flights."""
    differences = []
    for pair, cell in itertools.product(itertools.combinations(results.entrants, 2), results.groups):
        first, second = (
            [_Side(entrant, step, flights) for step, flights in parts(results.of(entrant, cell)).items()]
            for entrant in pair
        )
        differences += _differences(cell, metrics, list(zip(first, second, strict=True)), None)
    return differences


def _differences(
    cell: str, metrics: Sequence[str], sides: Sequence[tuple[_Side, _Side]], factor: int | None
) -> list[PairedDifference]:
    """Return the differences of the two sides in each metric, with Holm's correction over the rows of a metric.

    `factor`: the factor whose level differs between the sides; None: no level differs.
    """
    matched = [(first, second, _pairs_of(first.flights, second.flights, factor)) for first, second in sides]
    differences = []
    for metric in metrics:
        rows = [row for first, second, pairs in matched if (row := _difference(cell, metric, first, second, pairs))]
        adjusted = holm([row.difference.p for row in rows])
        differences += [replace(row, p_holm=p) for row, p in zip(rows, adjusted, strict=True)]
    return differences


def _pairs_of(first: Sequence[StudiedFlight], second: Sequence[StudiedFlight], factor: int | None) -> list[Pair]:
    """Return the pairs of flights with the same episode, flight number and levels of all factors but `factor`."""

    def key(flight: StudiedFlight) -> object:
        return flight.pair, flight.levels if factor is None else levels_besides(flight, factor)

    seconds = {key(flight): flight for flight in second}
    return [(flight, seconds[key(flight)]) for flight in first if key(flight) in seconds]


def _difference(cell: str, metric: str, first: _Side, second: _Side, pairs: Sequence[Pair]) -> PairedDifference | None:
    """Return the difference over the pairs; None if no pair has the metric in both flights."""
    partner = {id(a): b for a, b in pairs}
    groups = by_episode([a for a, _ in pairs]).values()
    shares: tuple[ShareEstimate, ...] = ()
    means, count = [], 0
    for group in groups:
        if metric == SUCCESS:
            changes = [float(a.scored.success) - partner[id(a)].scored.success for a in group]
        else:
            values = [(a.scored.values.get(metric), partner[id(a)].scored.values.get(metric)) for a in group]
            changes = [float(a) - float(b) for a, b in values if a is not None and b is not None]
        means += [statistics.fmean(changes)] if changes else []
        count += len(changes)
    if not means:
        return None
    if metric == SUCCESS:
        apart = len({id(b) for _, b in pairs})  # count a flight that is in several pairs once
        estimate = share_difference(means, max(1.0, apart / len(means)))
        shares = successes([a for a, _ in pairs]), successes([b for _, b in pairs])
    else:
        estimate = mean_difference(means)
    return PairedDifference(
        cell, metric, first.entrant, second.entrant, first.step, second.step, count, shares, estimate, estimate.p
    )


def point_title(factors: Sequence[StudiedFactor], point: StudyPoint, usual: StudyPoint) -> str:
    """Return the levels of a point that differ from the usual ones, for example: Wind 10 m/s."""
    changes = [
        f"{factor.words} {factor.label(level)}"
        for factor, level, common in zip(factors, point, usual, strict=True)
        if level != common
    ]
    text = ", ".join(changes) or UNDISTURBED
    return text[:1].upper() + text[1:]


def _ordered_points(results: StudyResults) -> list[StudyPoint]:
    """Return the flown points, those with fewer unusual levels first, then by factor and level."""
    points = dict.fromkeys(flight.levels for flight in results.scored)
    usual = _usual_levels(results.factors, points)
    rank = [{level: k for k, level in enumerate(_levels_from_reference(factor))} for factor in results.factors]

    def order(point: StudyPoint) -> tuple[object, ...]:
        off = [k for k, (level, common) in enumerate(zip(point, usual, strict=True)) if level != common]
        return len(off), off, [rank[k][point[k]] for k in range(len(point))]

    return sorted(points, key=order)


def _levels_from_reference(factor: StudiedFactor) -> list[StudiedLevel]:
    """Return the levels: numbers rise, or fall if the reference is the largest; words keep their order."""
    numeric = sorted(factor.levels, key=float) if factor.numeric else list(factor.levels)
    return numeric[::-1] if numeric[-1] == factor.reference else numeric


def _usual_levels(factors: Sequence[StudiedFactor], points: Iterable[StudyPoint]) -> StudyPoint:
    """Return the most frequent level of each factor. If several are equally frequent, the reference has priority."""
    usual = []
    for factor, column in zip(factors, zip(*points, strict=True), strict=True):
        counts = Counter(column)
        most = max(counts.values())
        common = [level for level in counts if counts[level] == most]
        usual.append(factor.reference if factor.reference in common else common[0])
    return tuple(usual)
