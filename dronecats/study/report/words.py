"""Findings in words: where half succeed, with its interval, and why there may be no such place."""

import math

from dronecats.judge.statistics.half import HalfSuccess
from dronecats.judge.statistics.mixed_logit import WIDEST
from dronecats.report.report_data import titled
from dronecats.report.table import rounded
from dronecats.study.analysis.halves import HalfAlong
from dronecats.study.analysis.studied import ALL, Studied, StudiedFactor

PERCENT = 100.0
NOWHERE = {
    "above all": "more than half at every level",
    "below all": "less than half at every level",
    "no slope": "not told: success hardly changes along it",
}


def cell_title(cell: str) -> str:
    """Return a cell as a head: Search-and-Track, All cells."""
    return ALL.capitalize() if cell == ALL else titled(cell) or "No cell"


def place(factor: StudiedFactor, told: HalfSuccess) -> str:
    """Return where half succeed, without the interval."""
    if told.where == "within" and told.value is not None:
        return factor.told(_short(told.value))
    if told.where == "between":
        return "between two levels"
    return NOWHERE[told.where]


def interval(factor: StudiedFactor, told: HalfSuccess) -> str:
    """Return the interval of the place where half succeed; what is beyond the levels is told as beyond them."""
    levels = [float(level) for level in factor.levels]
    least, most = factor.told(min(levels)), factor.told(max(levels))
    if told.scatter is None:  # all succeed or all fail, so that nothing was fitted
        return "outside of the levels"
    if told.low == math.inf:
        return f"above {most}"
    if told.high == -math.inf:
        return f"below {least}"
    low = f"below {least}" if told.low == -math.inf else factor.told(_short(told.low))
    high = f"above {most}" if told.high == math.inf else factor.told(_short(told.high))
    return f"{low} to {high}"


def scatter(told: HalfSuccess) -> str | float | None:
    """Return the episodes' scatter (log odds); in words where it is only known to be large."""
    return f"≥ {WIDEST:g}" if told.scatter == WIDEST else told.scatter


def beside(studied: Studied, along: HalfAlong) -> str:
    """Return what the other factors are at: wind 5 m/s; empty: there are none, or they are at their base."""
    if not along.beside:
        return ""
    rest = [factor for number, factor in enumerate(studied.factors) if number != along.factor]
    pairs = zip(rest, along.beside, strict=True)
    return ", ".join(f"{factor.name.replace('_', ' ')} {factor.told(level)}" for factor, level in pairs)


def half_sentence(studied: Studied, along: HalfAlong) -> str:
    """Return a sentence on where half succeed."""
    factor, told = studied.factors[along.factor], along.half
    who = f"{along.entrant}, {cell_title(along.cell).lower()}"
    if choice := beside(studied, along):
        who += f", {choice}"
    name = factor.name.replace("_", " ")
    if told.where == "within":
        return f"{who}: half of the flights succeed at a {name} of {place(factor, told)} ({interval(factor, told)})."
    if told.where == "between":
        return (
            f"{who}: success turns so sharply that no number is the best; half of the flights succeed somewhere at"
            f" a {name} of {interval(factor, told)}."
        )
    if told.where == "no slope":
        return f"{who}: the flights do not tell where half succeed, since success hardly changes with {name}."
    return f"{who}: no half-success within the range; {NOWHERE[told.where]}."


def probability(p: float) -> str:
    """Return a p as people read it."""
    return "< 0.001" if p < 0.001 else rounded(p, 3)


def points(share: float) -> str:
    """Return a difference of shares in points of 100, with its sign."""
    told = rounded(PERCENT * abs(share), 0)
    return told if told == "0" else f"{'−' if share < 0 else '+'}{told}"


def _short(value: float) -> float:
    """Return a number with three significant digits."""
    return float(f"{value:.3g}")
