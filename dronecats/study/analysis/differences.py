"""Computes differences of flights in pairs (equal seeds): factor level minus reference level, or pilot minus pilot."""

import itertools
import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
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

SUCCESS = "success"
METRICS = (SUCCESS, *(measure.name for measure in MEASURES))


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """The difference in a metric between two sides, the first minus the second, over their pairs of flights."""

    factor: int  # index in StudyResults.factors; -1: the sides are compared at points
    cell: str
    metric: str  # one of METRICS
    first: str  # entrant (pilot) of the first side
    second: str  # entrant of the second side; may be the same
    at: LevelStep  # the level of the first side
    against: LevelStep  # the level of the second side
    pairs: int  # number of pairs of flights
    difference: MeanDifference  # of shares (-1 … 1), or in the metric's unit; the statistical unit is the episode
    p_holm: float  # p with Holm's correction over the table's rows of the same entrants, cell and metric


def between_levels(results: StudyResults, factor: int) -> list[PairedDifference]:
    """Return the difference of each level of a factor from its reference, for the same entrant, seed and other factors.

    If a factor has many levels, `level_steps` groups them. The reference is still a single level, and the other levels
    of its group are in no pair.
    """
    steps, reference = level_steps(results.factors[factor]), _reference_step(results.factors[factor])
    differences = []
    for entrant, cell in results.lines():
        flights = results.of(entrant, cell)
        base = [flight for flight in flights if flight.levels[factor] in reference.members]
        for metric in METRICS:
            rows = []
            for step in (step for step in steps if not reference.members & step.members):
                at_step = [flight for flight in flights if flight.levels[factor] in step.members]
                pairs = pairs_of(at_step, base, factor)
                rows += difference(factor, cell, metric, (entrant, step), (entrant, reference), pairs)
            differences += _with_holm(rows)
    return differences


def between_entrants(results: StudyResults, factor: int) -> list[PairedDifference]:
    """Return the difference of each pair of entrants at each level of a factor, for the same seed and other factors.

    Only `comparable` flights are used, as in `level_results`.
    """
    steps, differences = level_steps(results.factors[factor]), []
    for (first, second), cell in itertools.product(itertools.combinations(results.entrants, 2), results.groups):
        by_entrant = [comparable(results, results.of(entrant, cell), factor) for entrant in (first, second)]
        for metric in METRICS:
            rows = []
            for step in steps:
                ours, theirs = ([f for f in flights if f.levels[factor] in step.members] for flights in by_entrant)
                rows += difference(factor, cell, metric, (first, step), (second, step), pairs_of(ours, theirs, None))
            differences += _with_holm(rows)
    return differences


Pair = tuple[StudiedFlight, StudiedFlight]


def _reference_step(factor: StudiedFactor) -> LevelStep:
    """Return a step that has only the reference level."""
    reference = factor.reference
    return LevelStep(factor.label(reference), None if isinstance(reference, str) else reference, frozenset({reference}))


def pairs_of(first: Sequence[StudiedFlight], second: Sequence[StudiedFlight], factor: int | None) -> list[Pair]:
    """Return the pairs of flights with the same episode, flight number and levels of all factors but `factor`."""

    def key(flight: StudiedFlight) -> object:
        return flight.pair, flight.levels if factor is None else levels_besides(flight, factor)

    seconds = {key(flight): flight for flight in second}
    return [(flight, seconds[key(flight)]) for flight in first if key(flight) in seconds]


def difference(
    factor: int,
    cell: str,
    metric: str,
    first: tuple[str, LevelStep],
    second: tuple[str, LevelStep],
    pairs: Sequence[Pair],
) -> list[PairedDifference]:
    """Return a list with one difference; empty if no pair has the metric in both flights."""
    partner = {id(a): b for a, b in pairs}
    if metric == SUCCESS:
        means = [
            statistics.fmean(a.scored.success - partner[id(a)].scored.success for a in group)
            for group in by_episode([a for a, _ in pairs]).values()
        ]
        apart = len({id(b) for _, b in pairs})  # count a flight that is in several pairs once
        estimate, count = share_difference(means, max(1.0, apart / max(1, len(means)))), len(pairs)
    else:
        means, count = [], 0
        for group in by_episode([a for a, _ in pairs]).values():
            values = [(a.scored.values.get(metric), partner[id(a)].scored.values.get(metric)) for a in group]
            changes = [float(a) - float(b) for a, b in values if a is not None and b is not None]
            means += [statistics.fmean(changes)] if changes else []
            count += len(changes)
        estimate = mean_difference(means)
    if not estimate.episodes:
        return []
    return [
        PairedDifference(factor, cell, metric, first[0], second[0], first[1], second[1], count, estimate, estimate.p)
    ]


def _with_holm(rows: Sequence[PairedDifference]) -> list[PairedDifference]:
    adjusted = holm([row.difference.p for row in rows])
    return [replace(row, p_holm=p) for row, p in zip(rows, adjusted, strict=True)]


NE = "ne_m"
POINTS_MAX = 100  # a study with more points, such as a Latin hypercube, gets no table of points
UNDISTURBED = "the usual levels"  # title of the point with the usual (most frequent) level of every factor

StudyPoint = tuple[StudiedLevel, ...]


@dataclass(frozen=True, slots=True)
class PointDifference:
    """The difference of two entrants at one point of the design. A point is one level of every factor."""

    first: str
    second: str
    cell: str
    title: str  # the levels that differ from the usual ones, for example: Wind 10 m/s
    shares: tuple[ShareEstimate, ShareEstimate]  # share of successes of the first and of the second entrant
    success: PairedDifference  # first minus second; Holm's correction: over all points of the pair in the cell
    ne: PairedDifference | None  # likewise for NE (navigation error); None: no pair has an NE in both flights


def point_differences(results: StudyResults) -> list[PointDifference]:
    """Return the difference of each pair of entrants at each point that both entrants flew.

    The list is empty for a study of one factor, or with more than POINTS_MAX points. A study that varies only the
    entrant has one point.
    """
    count = len({flight.levels for flight in results.scored})
    if len(results.factors) == 1 or not 0 < count <= POINTS_MAX:
        return []
    points = _ordered_points(results)
    usual = _usual_levels(results.factors, points)
    differences = []
    for (first, second), cell in itertools.product(itertools.combinations(results.entrants, 2), results.groups):
        rows = [row for point in points if (row := _point_difference(results, (first, second), cell, point, usual))]
        differences += _points_with_holm(rows)
    return differences


def pooled_differences(results: StudyResults, points: Iterable[PointDifference]) -> list[PairedDifference]:
    """Return the difference in success of each pair of entrants in `points`, pooled over all points that both flew.

    There is one difference per pair and cell. The statistical unit is the episode, with its mean over all points.
    """
    differences, step = [], LevelStep("all", None, frozenset())
    for first, second, cell in dict.fromkeys((point.first, point.second, point.cell) for point in points):
        pairs = pairs_of(results.of(first, cell), results.of(second, cell), None)
        differences += difference(-1, cell, SUCCESS, (first, step), (second, step), pairs)
    return differences


def point_title(factors: Sequence[StudiedFactor], point: StudyPoint, usual: StudyPoint) -> str:
    """Return the levels of a point that differ from the usual ones, for example: Wind 10 m/s."""
    changes = [
        f"{factor.words} {factor.label(level)}"
        for factor, level, common in zip(factors, point, usual, strict=True)
        if level != common
    ]
    text = ", ".join(changes) or UNDISTURBED
    return text[:1].upper() + text[1:]


def _point_difference(
    results: StudyResults, entrants: tuple[str, str], cell: str, point: StudyPoint, usual: StudyPoint
) -> PointDifference | None:
    title = point_title(results.factors, point, usual)
    step = LevelStep(title, None, frozenset())
    first, second = ([flight for flight in results.of(entrant, cell) if flight.levels == point] for entrant in entrants)
    pairs = pairs_of(first, second, None)
    sides = (entrants[0], step), (entrants[1], step)
    success = difference(-1, cell, SUCCESS, *sides, pairs)
    ne = difference(-1, cell, NE, *sides, pairs)
    if not success:
        return None
    shares = successes([a for a, _ in pairs]), successes([b for _, b in pairs])
    return PointDifference(*entrants, cell, title, shares, success[0], ne[0] if ne else None)


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


def _points_with_holm(rows: Sequence[PointDifference]) -> list[PointDifference]:
    success = _with_holm([row.success for row in rows])
    ne = iter(_with_holm([row.ne for row in rows if row.ne is not None]))
    return [
        replace(row, success=s, ne=None if row.ne is None else next(ne)) for row, s in zip(rows, success, strict=True)
    ]
