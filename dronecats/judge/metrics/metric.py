"""A metric: a named pure function of a flight read back, with its definition, unit and place in the paper.

And how the values of its steps become one of the episode.
"""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from dronecats.judge.judged_flight import FlightStep, JudgedFlight
from foundation.run_folder.rows import Decision

MetricValue = bool | float | None  # None: not defined for it, or not known; it is left out of every mean
MetricLevel = Literal["episode", "step"]  # what it is measured of, one value each
Better = Literal["more", "less"]
MetricFunction = Callable[[JudgedFlight], MetricValue | Sequence[MetricValue]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """What is measured, and how it is told."""

    name: str  # as --json, the columns of tables and SQL have it: a Python name with its unit, like ne_m
    title: str  # for a table's head
    unit: str  # "m", "s", "share" (0 … 1), "count", …
    level: MetricLevel
    definition: str  # one sentence
    paper: str  # its section; empty: ours
    better: Better | None  # which way is good; None: neither
    of: MetricFunction  # of level "episode": a value; of "step": a value per decision, in the order of the log

    @property
    def is_share(self) -> bool:
        """Whether a mean over episodes is a share of them, as a rate of successes is."""
        return self.unit == "share"


def of_counted(steps: Iterable[FlightStep], value: Callable[[FlightStep], MetricValue]) -> list[MetricValue]:
    """Return a value per decision, None after the cap."""
    return [value(step) if step.counts else None for step in steps]


def of_questions(steps: Iterable[FlightStep], value: Callable[[Decision], MetricValue]) -> list[MetricValue]:
    """Return what a question cost, once, at the first drone that it was for; None of the others and after the cap."""
    return [value(step.decision) if step.counts and step.asks else None for step in steps]


def known_values(values: Iterable[MetricValue]) -> list[float]:
    """Return those that are not None."""
    return [float(value) for value in values if value is not None]


def median(values: Iterable[MetricValue]) -> float | None:
    """Return the median of those that are known; None without any."""
    told = known_values(values)
    return statistics.median(told) if told else None


def mean(values: Iterable[MetricValue]) -> float | None:
    """Return the mean of those that are known, of truths their share; None without any."""
    told = known_values(values)
    return statistics.fmean(told) if told else None


def quantile(values: Iterable[MetricValue], share: float) -> float | None:
    """Return the quantile of those that are known, straight between neighbours; None without any."""
    told: Sequence[float] = sorted(known_values(values))
    if not told:
        return None
    at = share * (len(told) - 1)
    below = int(at)
    above = min(below + 1, len(told) - 1)
    return told[below] + (at - below) * (told[above] - told[below])
