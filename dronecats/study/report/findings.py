"""The findings of a study and their texts, computed once for the tables, the figures and the page.

A cell is a kind of episode. An entrant is a pilot of the study. A half-success level is the level of a factor at which
half of the flights succeed.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from dronecats.judge.statistics.half import HalfSuccess
from dronecats.judge.statistics.mixed_logit import WIDEST
from dronecats.report.report_data import cell_heading
from dronecats.report.table import rounded
from dronecats.study.analysis.differences import (
    PairedDifference,
    between_entrants,
    between_levels,
    point_differences,
    pooled_differences,
)
from dronecats.study.analysis.steps import ServedRate, TargetMotionResult, served_rates, target_motions
from dronecats.study.analysis.study_results import ALL, LevelResult, StudiedFactor, StudyResults, level_results
from dronecats.study.analysis.success_fits import (
    HalfSuccessFit,
    HeatMap,
    MainEffect,
    half_success_fits,
    heat_maps,
    main_effects,
)


@dataclass(frozen=True, slots=True)
class FactorFindings:
    number: int  # index of the factor
    factor: StudiedFactor
    levels: tuple[LevelResult, ...]
    halves: tuple[HalfSuccessFit, ...]  # half-success levels
    between_levels: tuple[PairedDifference, ...]
    between_entrants: tuple[PairedDifference, ...]
    served: tuple[ServedRate, ...]
    motions: tuple[TargetMotionResult, ...]

    def artifact_name(self, name: str) -> str:
        return f"{name}_{self.factor.name}"


@dataclass(frozen=True, slots=True)
class Findings:
    results: StudyResults
    command: str  # command line that makes the report
    factors: tuple[FactorFindings, ...]
    effects: tuple[MainEffect, ...]
    maps: tuple[HeatMap, ...]
    points: tuple[PairedDifference, ...]  # differences between entrants at each point (one level per factor)
    pooled: tuple[PairedDifference, ...]  # differences between entrants, pooled over all points

    def maps_by_pair(self) -> Iterator[tuple[tuple[StudiedFactor, StudiedFactor], list[HeatMap]]]:
        """Yield ((factor of the rows, factor of the columns), heat maps) for each pair of factors."""
        for pair in dict.fromkeys((heat_map.rows, heat_map.columns) for heat_map in self.maps):
            factors = self.results.factors[pair[0]], self.results.factors[pair[1]]
            yield factors, [heat_map for heat_map in self.maps if (heat_map.rows, heat_map.columns) == pair]


def compute_findings(results: StudyResults, command: str) -> Findings:
    """Return the findings of a study; `command` is the command line of the report."""
    points = point_differences(results)
    return Findings(
        results=results,
        command=command,
        factors=tuple(_along(results, number) for number in range(len(results.factors))),
        effects=tuple(main_effects(results)),
        maps=tuple(heat_maps(results)),
        points=tuple(points),
        pooled=tuple(pooled_differences(results, points)),
    )


def _along(results: StudyResults, number: int) -> FactorFindings:
    return FactorFindings(
        number=number,
        factor=results.factors[number],
        levels=tuple(level_results(results, number)),
        halves=tuple(half_success_fits(results, number)),
        between_levels=tuple(between_levels(results, number)),
        between_entrants=tuple(between_entrants(results, number)),
        served=tuple(served_rates(results, number)),
        motions=tuple(target_motions(results, number)),
    )


PERCENT = 100.0
SHARES = {"above all": "more than half", "below all": "less than half"}  # keys: values of HalfSuccess.where
NOWHERE = {  # text for a value of HalfSuccess.where if no level is the half-success level
    **{where: f"{share} at every level" for where, share in SHARES.items()},
    "no slope": "unknown, because the interval has no bounds",
}


def cell_title(cell: str) -> str:
    """Return a cell as a heading, for example: Search-and-Track, or All cells."""
    return ALL.capitalize() if cell == ALL else cell_heading(cell) or "No cell"


def in_cell(entrant: str, cell: str) -> str:
    """Return the text for an entrant or a pair in a cell, such as "oracle, all cells"."""
    return f"{entrant}, {cell_title(cell).lower()}"


def half_place(factor: StudiedFactor, half: HalfSuccess) -> str:
    """Return the half-success level as text, without the interval."""
    if half.where == "within" and half.value is not None:
        return factor.label(_three_digits(half.value))
    if half.where == "between":
        return "between two levels"
    return NOWHERE[half.where]


def half_interval(factor: StudiedFactor, half: HalfSuccess) -> str:
    """Return the interval of the half-success level as text; "below …" or "above …" for ends outside of the levels."""
    levels = [float(level) for level in factor.levels]
    least, most = factor.label(min(levels)), factor.label(max(levels))
    beyond = {-math.inf: f"below {least}", math.inf: f"above {most}"}
    low, high = (beyond.get(end) or factor.label(_three_digits(end)) for end in (half.low, half.high))
    if half.low > half.high:  # the side is unknown
        if math.isinf(half.low) and math.isinf(half.high):
            return "outside of the levels"
        below = high if math.isinf(half.high) else f"up to {high}"
        return f"{below}, or {low if math.isinf(half.low) else f'{low} and more'}"
    return low if half.low == half.high else f"{low} to {high}"


def scatter_value(half: HalfSuccess) -> str | float | None:
    """Return the scatter (log odds) of the episodes, or "≥ 12" if it is WIDEST, the limit of the fit."""
    return f"≥ {WIDEST:g}" if half.scatter == WIDEST else half.scatter


def other_levels(results: StudyResults, fit: HalfSuccessFit) -> str:
    """Return the levels of the other factors as text, for example: wind 5 m/s.

    Empty if the factor was studied at only one combination of these levels.
    """
    if not fit.beside:
        return ""
    rest = [factor for number, factor in enumerate(results.factors) if number != fit.factor]
    pairs = zip(rest, fit.beside, strict=True)
    return ", ".join(f"{factor.words} {factor.label(level)}" for factor, level in pairs)


def half_sentence(results: StudyResults, fit: HalfSuccessFit) -> str:
    factor, half = results.factors[fit.factor], fit.half
    subject = in_cell(fit.entrant, fit.cell)
    if choice := other_levels(results, fit):
        subject += f", {choice}"
    if half.where == "within":
        place = f"{half_place(factor, half)} ({half_interval(factor, half)})"
        return f"{subject}: half of the flights succeed at a {factor.words} of {place}."
    if half.where == "between":
        return (
            f"{subject}: success changes so sharply that no single level is the best estimate; half of the flights"
            f" succeed at a {factor.words} of {half_interval(factor, half)}."
        )
    if half.where == "no slope":
        return f"{subject}: the half-success level is unknown, because its interval is unbounded on both sides."
    return f"{subject}: {SHARES[half.where]} of the flights succeed at every level of {factor.words}."


def equals_p(p: float) -> str:
    """Return a p value with its relation, for example: = 0.012, or < 0.001."""
    text = probability(p)
    return text if text.startswith("<") else f"= {text}"


def probability(p: float) -> str:
    return "< 0.001" if p < 0.001 else rounded(p, 3)


def points(share: float) -> str:
    """Return a difference of shares in percentage points, with its sign."""
    text = rounded(PERCENT * abs(share), 0)
    return text if text == "0" else f"{'−' if share < 0 else '+'}{text}"


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")
