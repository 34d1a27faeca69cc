"""What a metric returns, and how the values of steps become one of the episode."""

import statistics
from collections.abc import Iterable, Sequence

MetricValue = bool | float | None  # None: not defined for it, or not known; it is left out of every mean


def known(values: Iterable[MetricValue]) -> list[float]:
    """Return those that are not None."""
    return [float(value) for value in values if value is not None]


def median(values: Iterable[MetricValue]) -> float | None:
    """Return the median of those that are known; None without any."""
    told = known(values)
    return statistics.median(told) if told else None


def mean(values: Iterable[MetricValue]) -> float | None:
    """Return the mean of those that are known, of truths their share; None without any."""
    told = known(values)
    return statistics.fmean(told) if told else None


def quantile(values: Iterable[MetricValue], share: float) -> float | None:
    """Return the quantile of those that are known, straight between neighbours; None without any."""
    told: Sequence[float] = sorted(known(values))
    if not told:
        return None
    at = share * (len(told) - 1)
    below = int(at)
    above = min(below + 1, len(told) - 1)
    return told[below] + (at - below) * (told[above] - told[below])
