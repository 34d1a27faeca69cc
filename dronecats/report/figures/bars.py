"""The paper's three bar figures: nested reaching, declaring and succeeding; failure modes; a fleet's drones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dronecats.report import names
from dronecats.report.figures import style
from dronecats.report.report_table import ReportTable, TableCell, TableRow, rounded

NESTED = (  # column of the table, what it is called, colour
    (f"approaching_{names.ORACLE_SUCCESS}_percent", "came within the radius", style.SKY),
    (f"approaching_{names.DECLARED}_percent", "declared arrival", style.ORANGE),
    (f"approaching_{names.SUCCESS}_percent", "succeeded", style.BLUE),
)
MODE_COLOURS = (style.BLUE, style.VERMILION, style.ORANGE, style.PURPLE, style.GREEN, style.SKY, style.LIGHT, "#FFFFFF")
DRONE_COLOURS = (style.BLUE, style.VERMILION, style.ORANGE, style.LIGHT)
WRITTEN = 7.0  # %, the narrowest part with its number in it


@dataclass(frozen=True, slots=True)
class BarPart:
    """A kind of part of a stacked bar."""

    column: str
    title: str
    colour: str


def nested(table: ReportTable) -> Any:
    """Return the figure of the table `approaching`: for each line how often it reached, declared, succeeded."""
    found, heads = style.lines(table)
    made, axis = style.figure(found[-1].y + 1.0, line_in=0.36)
    for k, (column, title, colour) in enumerate(NESTED):
        cells = [cell(table, line.row, column) for line in found]
        heights = [line.y + 0.26 * (k - 1) for line in found]
        axis.barh(heights, [number(c) for c in cells], height=0.24, color=colour, label=title)
        for c, y in zip(cells, heights, strict=True):
            if c.low is not None and c.high is not None:
                axis.plot([c.low, c.high], [y, y], color=style.INK, linewidth=0.9, solid_capstyle="butt")
    style.named(axis, found, heads)
    _percent(axis, "% of the flights of approaching; lines: 95 % intervals")
    made.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return made


def modes(table: ReportTable) -> Any:
    """Return the figure of the table `failures`: all flights of a line in one bar, parted by how they ended."""
    colours = zip(names.MODES, MODE_COLOURS, strict=True)
    parts = [BarPart(mode.column, mode.title, colour) for mode, colour in colours]
    made, axis = _stacked(table, parts)
    _percent(axis, "% of the one-drone flights")
    made.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return made


def decomposition(table: ReportTable) -> Any:
    """Return the figure of the table `drones`: what drones came to as bars, the episodes won as diamonds."""
    colours = zip(names.DRONES, DRONE_COLOURS, strict=True)
    made, axis = _stacked(table, [BarPart(o.column, o.title, colour) for o, colour in colours])
    found, _ = style.lines(table)
    won = [number(cell(table, line.row, f"commanding_{names.SUCCESS}_percent")) for line in found]
    below = [line.y + 0.36 for line in found]  # on the bar's edge, where no number stands
    axis.plot(won, below, "D", color="white", markeredgecolor=style.INK, markersize=4.5, label="Episodes won",
              linestyle="", clip_on=False, zorder=5)  # fmt: skip
    _percent(axis, "% of the drones; diamonds: % of the episodes")
    made.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return made


def cell(table: ReportTable, row: TableRow, column: str) -> TableCell:
    """Return a row's cell of a column by its name."""
    return row.cells[[each.name for each in table.columns].index(column)]


def number(told: TableCell) -> float:
    """Return a cell's number, 0 where there is none."""
    return float(told.value) if isinstance(told.value, int | float) else 0.0


def _stacked(table: ReportTable, parts: Sequence[BarPart]) -> tuple[Any, Any]:
    found, heads = style.lines(table)
    made, axis = style.figure(found[-1].y + 1.0, below_in=0.95)
    begins = [0.0] * len(found)
    for each in parts:
        widths = [number(cell(table, line.row, each.column)) for line in found]
        if not any(widths):
            continue
        axis.barh([line.y for line in found], widths, left=begins, height=0.72, color=each.colour, label=each.title,
                  edgecolor=style.GREY if each.colour == "#FFFFFF" else "white", linewidth=0.6)  # fmt: skip
        dark = each.colour in (style.BLUE, style.VERMILION, style.GREEN)
        for line, begin, width in zip(found, begins, widths, strict=True):
            if width >= WRITTEN:
                axis.text(begin + width / 2, line.y, rounded(width, 0), ha="center", va="center", fontsize=7,
                          color="white" if dark else style.INK)  # fmt: skip
        begins = [begin + width for begin, width in zip(begins, widths, strict=True)]
    style.named(axis, found, heads)
    return made, axis


def _percent(axis: Any, label: str) -> None:
    axis.set_xlim(0, 100)
    axis.set_xlabel(label)
