"""Defines a metric: a named pure function of a recorded flight, with definition, unit and section of the paper.

`median`, `mean` and `quantile` summarize the values of a flight's steps.
"""

import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from dronecats.judge.judged_flight import FlightStep, JudgedFlight

MetricValue = bool | float | None  # None: undefined or unknown; it is left out of every mean
MetricLevel = Literal["episode", "step"]  # whether a metric has one value per episode, or one per step
Better = Literal["more", "less"]
MetricFunction = Callable[[JudgedFlight], MetricValue | Sequence[MetricValue]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Metric:
    """A metric and its presentation."""

    name: str  # in --json, columns of tables and SQL: a Python name with its unit, like ne_m
    title: str  # column heading in tables
    unit: str  # "m", "s", "share" (0 … 1), "count", …
    level: MetricLevel
    definition: str  # one sentence
    paper: str  # section of the paper; empty: not in the paper
    better: Better | None  # the good direction; None: neither
    of: MetricFunction  # returns a value; for the level "step" a value per decision, in the order of the log

    @property
    def is_share(self) -> bool:
        """Whether the mean over episodes is a share of the episodes, such as a success rate."""
        return self.unit == "share"

    @property
    def value_type(self) -> type[bool] | type[int] | type[float]:
        """The type of one value and of the SQL column. A share per step is a float, because a step may lack a value."""
        if self.unit == "count":
            return int
        return bool if self.is_share and self.level == "episode" else float


def per_step(value: Callable[[FlightStep], MetricValue]) -> Callable[[JudgedFlight], list[MetricValue]]:
    """Return the function that gives `value` of each decision of a flight; None after the time limit."""
    return lambda flight: [value(step) if step.counts else None for step in flight.steps]


def verdict_value(part: str, name: str) -> MetricFunction:
    """Return the function that reads a field of a part of the verdict; None: the verdict does not have the part."""
    return lambda flight: getattr(getattr(flight.verdict, part), name, None)


def known_values(values: Iterable[MetricValue]) -> list[float]:
    return [float(value) for value in values if value is not None]


def median(values: Iterable[MetricValue]) -> float | None:
    """Return the median of the known values; None if there are none."""
    numbers = known_values(values)
    return statistics.median(numbers) if numbers else None


def mean(values: Iterable[MetricValue]) -> float | None:
    """Return the mean of the known values (for booleans, the share of True); None if there are none."""
    numbers = known_values(values)
    return statistics.fmean(numbers) if numbers else None


def quantile(values: Iterable[MetricValue], share: float) -> float | None:
    """Return the quantile at `share` (0 … 1) of the known values, interpolated linearly; None if there are none."""
    numbers = sorted(known_values(values))
    if not numbers:
        return None
    at = share * (len(numbers) - 1)
    below = int(at)
    above = min(below + 1, len(numbers) - 1)
    return numbers[below] + (at - below) * (numbers[above] - numbers[below])
