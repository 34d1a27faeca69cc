"""Those who fly beside one another at every point of a design, on the same seeds, in one family of comparisons."""

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from dronecats.judge.statistics.paired import holm
from dronecats.judge.statistics.shares import KnownShare
from dronecats.study.analysis.levels import LevelStep, successes
from dronecats.study.analysis.paired_flights import SUCCESS, PairedDifference, difference, pairs_of
from dronecats.study.analysis.studied import Studied, StudiedFactor, StudiedLevel

NE = "ne_m"
POINTS_MAX = 100  # beyond, as of a Latin hypercube, nobody reads a line of each
UNDISTURBED = "the usual levels"  # of all factors

FlownPoint = tuple[StudiedLevel, ...]


@dataclass(frozen=True, slots=True)
class AtPoint:
    """Two entrants at one choice of all factors."""

    first: str
    second: str
    cell: str
    title: str  # the levels that are not the usual ones: Wind 10 m/s
    shares: tuple[KnownShare, KnownShare]  # of successes of the pairs, the first's and the second's
    success: PairedDifference  # the first less the second; Holm over all points of both entrants and the cell
    ne: PairedDifference | None  # None: no pair has it


def at_points(studied: Studied) -> list[AtPoint]:
    """Return each two entrants at each point that both flew, in the points' order; nothing of a study of one factor."""
    count = len({each.levels for each in studied.scored})
    if len(studied.factors) < 2 or not 0 < count <= POINTS_MAX:
        return []
    points = _ordered(studied)
    usual = _usual(studied.factors, points)
    found = []
    for (one, other), cell in itertools.product(itertools.combinations(studied.entrants, 2), studied.groups):
        told = [
            made
            for point in points
            if (made := _at_point(studied, (one, other), cell, point, title(studied.factors, point, usual)))
        ]
        found += _corrected(told)
    return found


def over_points(studied: Studied, points: Iterable[AtPoint]) -> list[PairedDifference]:
    """Return the success of each two entrants of these points over all of them alike, in every cell.

    Episodes are the unit: what one comes to at all the points is one number.
    """
    found, step = [], LevelStep("all", None, frozenset())
    for one, other, cell in dict.fromkeys((each.first, each.second, each.cell) for each in points):
        pairs = pairs_of(studied.of(one, cell), studied.of(other, cell), None)
        found += difference(-1, cell, SUCCESS, (one, step), (other, step), pairs)
    return found


def title(factors: Sequence[StudiedFactor], point: FlownPoint, usual: FlownPoint) -> str:
    """Return a point in words: what is not as usual there."""
    others = [
        f"{factor.name.replace('_', ' ')} {factor.told(level)}"
        for factor, level, common in zip(factors, point, usual, strict=True)
        if level != common
    ]
    told = ", ".join(others) or UNDISTURBED
    return told[:1].upper() + told[1:]


def _at_point(studied: Studied, both: tuple[str, str], cell: str, point: FlownPoint, name: str) -> AtPoint | None:
    step = LevelStep(name, None, frozenset())
    here, there = ([each for each in studied.of(entrant, cell) if each.levels == point] for entrant in both)
    pairs = pairs_of(here, there, None)
    sides = (both[0], step), (both[1], step)
    success = difference(-1, cell, SUCCESS, *sides, pairs)
    ne = difference(-1, cell, NE, *sides, pairs)
    if not success:
        return None
    shares = successes([a for a, _ in pairs]), successes([b for _, b in pairs])
    return AtPoint(*both, cell, name, shares, success[0], ne[0] if ne else None)


def _ordered(studied: Studied) -> list[FlownPoint]:
    """Return the points that were flown, those with fewer unusual levels first, then by factor and level."""
    points = dict.fromkeys(each.levels for each in studied.scored)
    usual = _usual(studied.factors, points)
    rank = [{level: k for k, level in enumerate(_sorted(factor))} for factor in studied.factors]

    def order(point: FlownPoint) -> tuple[object, ...]:
        off = [k for k, (level, common) in enumerate(zip(point, usual, strict=True)) if level != common]
        return len(off), off, [rank[k][point[k]] for k in range(len(point))]

    return sorted(points, key=order)


def _sorted(factor: StudiedFactor) -> list[StudiedLevel]:
    """Return a factor's levels from its reference on."""
    numeric = sorted(factor.levels, key=float) if factor.numeric else list(factor.levels)
    return numeric[::-1] if numeric[-1] == factor.reference else numeric


def _usual(factors: Sequence[StudiedFactor], points: Iterable[FlownPoint]) -> FlownPoint:
    """Return each factor's level at most points, its reference where several are at as many."""
    found = []
    for factor, column in zip(factors, zip(*points, strict=True), strict=True):
        times = Counter(column)
        most = max(times.values())
        common = [level for level in times if times[level] == most]
        found.append(factor.reference if factor.reference in common else common[0])
    return tuple(found)


def _corrected(told: Sequence[AtPoint]) -> list[AtPoint]:
    by_success = holm([each.success.difference.p for each in told])
    with_ne = [each.ne for each in told if each.ne is not None]
    by_ne = iter(holm([each.difference.p for each in with_ne]))
    return [
        replace(
            each,
            success=replace(each.success, p_holm=p),
            ne=None if each.ne is None else replace(each.ne, p_holm=next(by_ne)),
        )
        for each, p in zip(told, by_success, strict=True)
    ]
