"""The cells of a table, computed from flights: shares with their intervals, means, medians, quantiles."""

import statistics
from collections.abc import Callable, Iterable, Sequence

from dronecats.judge.statistics.shares import known_share
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.table import TableCell, TableColumn

PERCENT = 100.0
NONE = TableCell(value=None)
NAME = TableColumn(name="pilot", title="Pilot", align="left")
FLIGHTS = TableColumn(name="flights", title="Flights")
ERRORS = TableColumn(name="not_scored", title="Not scored")


def percent(flown: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the share (%) of flights for which a metric holds, with its interval; episodes are the unit.

    What is not known of a flight is left out, and so are flights that are nobody's score.
    """
    outcomes: dict[str, list[bool]] = {}
    for each in flown:
        value = each.values.get(metric) if each.scored else None
        if value is not None:
            outcomes.setdefault(each.episode, []).append(bool(value))
    known = known_share(list(outcomes.values()))
    if not known.trials:
        return NONE
    low, high = PERCENT * known.low, PERCENT * known.high
    return TableCell(value=PERCENT * known.share, low=low, high=high, count=known.successes, of=known.trials)


def part(count: int, of: int) -> TableCell:
    """Return a share (%) of what is no sample of episodes, as of steps or of drones; without an interval."""
    return TableCell(value=PERCENT * count / of, count=count, of=of) if of else NONE


def mean(flown: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the mean of a metric over the flights that have it."""
    return _of(_known(flown, metric), statistics.fmean)


def median(flown: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the median of a metric over the flights that have it."""
    return _of(_known(flown, metric), statistics.median)


def total(flown: Iterable[ScoredEpisode], metric: str) -> TableCell:
    """Return the sum of a metric over the flights that have it."""
    return _of(_known(flown, metric), sum)


def steps(flown: Iterable[ScoredEpisode], metric: str) -> list[float]:
    """Return a metric of steps, of every step that has it."""
    return [float(v) for each in flown if each.scored for v in each.steps.get(metric, ()) if v is not None]


def quantile(values: Sequence[float], share: float) -> TableCell:
    """Return a quantile, linear between values."""
    if not values:
        return NONE
    ordered = sorted(values)
    place = share * (len(ordered) - 1)
    below = int(place)
    above = min(below + 1, len(ordered) - 1)
    value = ordered[below] + (place - below) * (ordered[above] - ordered[below])
    return TableCell(value=value, of=len(ordered))


def count(number: int | None) -> TableCell:
    """Return a plain count."""
    return TableCell(value=number)


def errors(flown: Iterable[ScoredEpisode]) -> TableCell:
    """Return how many flights are nobody's score."""
    return count(sum(not each.scored for each in flown))


def _known(flown: Iterable[ScoredEpisode], metric: str) -> list[float]:
    told = (each.values.get(metric) for each in flown if each.scored)
    return [float(value) for value in told if value is not None]


def _of(values: Sequence[float], what: Callable[[Sequence[float]], float]) -> TableCell:
    return TableCell(value=float(what(values)), of=len(values)) if values else NONE
