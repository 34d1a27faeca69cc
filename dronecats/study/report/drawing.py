"""Writes the figures of a study's report as SVG, PDF and PNG, in the order of the report's sections."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report import figures as style
from dronecats.study.report import curves, forests
from dronecats.study.report.findings import FactorFindings, Findings

FigureFunction = Callable[[Findings, FactorFindings], Any]
ALONG: tuple[tuple[str, str, FigureFunction], ...] = (  # the figures of each factor: name, caption, function
    (
        "success",
        "Success rate at each level with 95 % intervals; the logistic fit with its band. The mark on the 50 % line"
        " is the level at which half of the flights succeed, with its interval.",
        curves.success_figure,
    ),
    (
        "success_beside",
        "Success rate at each level, over all cells, for each choice of the other factors, with the fits."
        " The marks on the 50 % line are the levels at which half of the flights succeed.",
        curves.success_by_choice_figure,
    ),
    (
        "measures",
        "Distance at the decisive measurement, dwell and longest loss at each level: means over episodes with 95 %"
        " intervals.",
        curves.measures_figure,
    ),
    (
        "against_reference",
        "Paired differences of success on the same seeds, with 95 % intervals. Filled: significant in the"
        " randomisation test after Holm's correction.",
        forests.between_levels,
    ),
    (
        "between_entrants",
        "Paired differences of success between entrants, on the same seeds, with 95 % intervals. Filled:"
        " significant in the randomisation test after Holm's correction.",
        forests.between_entrants,
    ),
    (
        "target_motion",
        "Metres that a moving target moves during one decision, and the width of the view at its depth: medians,"
        " with the range of 90 % of the steps.",
        curves.target_motion_figure,
    ),
    ("served", "Served control rate at each level, over all steps.", curves.served_figure),
)
POINTS = (
    "at_points",
    "Paired differences of success between entrants, on the same seeds, at every point of the design, with 95 %"
    " intervals. Filled: significant in the randomisation test after Holm's correction over all points.",
)
EFFECTS = (
    "main_effects",
    "Change of the log odds of success from each factor's lowest to its highest level, with the other factors at"
    " their mean, and 95 % intervals. Filled: significant after Holm's correction.",
)
HEAT_MAP = "Success rate over two factors, pooled over the others."


@dataclass(frozen=True, slots=True)
class StudyFigure:
    name: str  # name of its files, without suffix
    caption: str  # one or two sentences
    path: Path  # PNG file; the SVG and PDF files have the same folder and name


def draw(findings: Findings, out: Path) -> list[StudyFigure]:
    """Draw all figures that have data as SVG, PDF and PNG into a folder. Raises InfrastructureError."""
    with style.styled():
        return [
            StudyFigure(name, caption, style.save(figure, out, name))
            for name, caption, figure in _figures(findings)
            if figure is not None
        ]


def _figures(findings: Findings) -> Iterator[tuple[str, str, Any]]:
    """Yield (name, caption, figure or None)."""
    yield *POINTS, forests.point_differences(findings)
    for along in findings.factors:
        for name, caption, draw_figure in ALONG:
            yield along.artifact_name(name), caption, draw_figure(findings, along)
    yield *EFFECTS, forests.main_effects(findings)
    for (down, across), maps in findings.maps_by_pair():
        yield f"interaction_{down.name}_{across.name}", HEAT_MAP, forests.heat_maps(findings, maps)
