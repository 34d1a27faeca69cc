"""A metric: a named pure function of a flight read back, with its definition, unit and place in the paper."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from dronecats.judge.judged_flight import JudgedFlight
from dronecats.judge.metrics.value import MetricValue
from dronecats.judge.metrics.value import MetricValue as Value

__all__ = ["Better", "Metric", "MetricFunction", "MetricLevel", "MetricValue", "Value"]

MetricLevel = Literal["episode", "step"]  # what it is measured of, one value each
Better = Literal["more", "less"]
MetricFunction = Callable[[JudgedFlight], "MetricValue | Sequence[MetricValue]"]


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
