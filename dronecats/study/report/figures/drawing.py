"""Every figure of a study's report, in the order of its sections."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report.figures import style
from dronecats.study.report.figures import curves, forests
from dronecats.study.report.findings import FactorFindings, Findings

OutOfFindings = Callable[[Findings, FactorFindings], Any]
ALONG: tuple[tuple[str, str, OutOfFindings], ...] = (  # name, what it shows, what draws it
    (
        "success",
        "Success rate at each level with 95 % intervals; the logistic fit with its band; on the line of a half, where"
        " half of the flights succeed, with its interval.",
        curves.success,
    ),
    (
        "success_beside",
        "Success rate at each level, over all cells, for each choice of the other factors, with the fits;"
        " on the line of a half, where half of the flights succeed.",
        curves.beside,
    ),
    (
        "measures",
        "Distance at the decisive measurement, dwell and longest loss at each level: means over episodes with 95 %"
        " intervals.",
        curves.measures,
    ),
    (
        "against_reference",
        "Paired differences of success on the same seeds, with 95 % intervals. Filled: told apart by the"
        " randomisation test after Holm's correction.",
        forests.between_levels,
    ),
    (
        "between_entrants",
        "Paired differences of success between those who fly, on the same seeds, with 95 % intervals. Filled: told"
        " apart by the randomisation test after Holm's correction.",
        forests.between_entrants,
    ),
    (
        "target_motion",
        "Metres that a moving target moves during one decision, beside the width of the picture at its depth: medians,"
        " and what 90 % of the steps lie between.",
        curves.motion,
    ),
    ("served", "Control rate that was served at each level, over all steps.", curves.served),
)
POINTS = (
    "at_points",
    "Paired differences of success between those who fly, on the same seeds, at every point of the design, with 95 %"
    " intervals. Filled: told apart by the randomisation test after Holm's correction over all points.",
)
EFFECTS = (
    "main_effects",
    "Change of the log odds of success from each factor's lowest to its highest level, the others at their middle, with"
    " 95 % intervals. Filled: told from 0 after Holm's correction.",
)
HEAT = "Success rate over two factors, whatever the others are at."


@dataclass(frozen=True, slots=True)
class StudyFigure:
    """A figure that was drawn."""

    name: str  # of its files
    of: str  # factor's name; empty: of several
    shows: str  # a sentence or two
    path: Path  # of the PNG; SVG and PDF lie beside it


def draw(found: Findings, out: Path) -> list[StudyFigure]:
    """Draw what there is to draw as SVG, PDF and PNG into a folder. Raises InfrastructureError."""
    with style.styled():
        return [
            StudyFigure(name, of, shows, style.save(figure, out, name)) for name, of, shows, figure in _figures(found)
        ]


def _figures(found: Findings) -> Iterator[tuple[str, str, str, Any]]:
    if (figure := forests.at_points(found)) is not None:
        yield POINTS[0], "", POINTS[1], figure
    for along in found.factors:
        for name, shows, drawn in ALONG:
            figure = drawn(found, along)
            if figure is not None:
                yield along.named(name), along.factor.name, shows, figure
    if (figure := forests.effects(found)) is not None:
        yield EFFECTS[0], "", EFFECTS[1], figure
    for pair in dict.fromkeys((each.rows, each.columns) for each in found.maps):
        down, across = (found.studied.factors[number].name for number in pair)
        maps = [each for each in found.maps if (each.rows, each.columns) == pair]
        yield f"interaction_{down}_{across}", "", HEAT, forests.heat(found, maps)
