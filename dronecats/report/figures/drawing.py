"""Every figure of the report: the paper's three bar figures, the served rate, and the grid of episodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report import names
from dronecats.report.figures import style
from dronecats.report.report_data import BUILT_IN, MODELS, ReportData, titled
from dronecats.report.table import ReportTable, TableCell, TableRow, rounded
from dronecats.report.tables.measures import QUANTILES
from episodes.records.record import CELLS

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


def rates(table: ReportTable) -> Any:
    """Return the figure of the table `served`: whiskers from 5 to 95 %, the box from 25 to 75, a line at the median."""
    found, heads = style.lines(table)
    made, axis = style.figure(found[-1].y + 1.0, below_in=0.6)
    for line in found:
        told = [cell(table, line.row, f"rate_{q}_hz").value for q in QUANTILES]
        low, begin, middle, end, high = (float(value) for value in told if isinstance(value, int | float))
        axis.plot([low, high], [line.y, line.y], color=style.INK, linewidth=0.8)
        axis.barh(
            line.y, end - begin, left=begin, height=0.5, color=style.SKY, edgecolor=style.INK, linewidth=0.6, zorder=3
        )
        axis.plot([middle, middle], [line.y - 0.25, line.y + 0.25], color=style.INK, linewidth=1.6, zorder=4)
    style.named(axis, found, heads)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("decisions per second of vehicle time: 5, 25, 50, 75 and 95 % of the steps")
    return made


SIDE = 0.84  # of a square


def episode_grid(data: ReportData) -> Any:
    """Return the figure: a line for each entrant, a column for each episode, filled by the share of flights solved."""
    order = {cell: k for k, cell in enumerate(CELLS)}
    flown = {each.episode: (order.get(each.cell, len(CELLS)), each.map, each.episode) for each in data.episodes}
    columns = sorted(flown, key=lambda name: flown[name])
    lines, heads, y = [], [], 0.0
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        members = [entrant for entrant in data.entrants if entrant.is_model is is_model]
        if members:
            heads.append((title, y))
            y += 0.9
        for entrant in members:
            lines.append((entrant, y))
            y += 1.0
    made, axis = style.figure(y + 0.5, line_in=0.24, below_in=1.15)
    for entrant, height in lines:
        for x, name in enumerate(columns):
            _grid_square(
                axis, x, height, entrant.by_episode.get(name), any(e.episode == name for e in entrant.episodes)
            )
    _grid_groups(axis, [(flown[name][0], flown[name][1]) for name in columns], y)
    axis.set_yticks([height for _, height in lines], [entrant.label for entrant, _ in lines])
    axis.tick_params(axis="both", length=0)
    for title, height in heads:
        axis.annotate(title, (0.0, height), xytext=(-4, 0), xycoords=("axes fraction", "data"), ha="right",
                      textcoords="offset points", va="center", style="italic", color=style.GREY)  # fmt: skip
    axis.set_xlim(-0.7, len(columns) - 0.3)
    axis.set_ylim(y - 0.3, -0.6)
    for spine in axis.spines.values():
        spine.set_visible(False)
    made.legend(handles=_grid_keys(), loc="outside lower center", ncols=4)
    return made


def _grid_square(axis: Any, x: int, y: float, scored: Any, tried: bool) -> None:
    """Draw one entrant's flights of one episode."""
    from matplotlib.patches import Rectangle

    if scored:
        share = sum(each.success for each in scored) / len(scored)
        filled = SIDE * share  # from below
        for top, height, colour in ((-SIDE / 2, SIDE - filled, style.LIGHT), (SIDE / 2 - filled, filled, style.BLUE)):
            if height > 0:
                axis.add_patch(Rectangle((x - SIDE / 2, y + top), SIDE, height, facecolor=colour, linewidth=0))
    elif tried:
        axis.plot(x, y, "x", color=style.VERMILION, markersize=3, markeredgewidth=0.8)


def _grid_groups(axis: Any, groups: list[tuple[int, str]], bottom: float) -> None:
    """Name the columns by cell and map, with a line between."""
    ticks, labels = [], []
    begin = 0
    for end in range(1, len(groups) + 1):
        if end == len(groups) or groups[end] != groups[begin]:
            cell, map_ = groups[begin]
            ticks.append((begin + end - 1) / 2)
            labels.append(f"{titled(CELLS[cell]) if cell < len(CELLS) else 'Other'}\n{map_}")
            if end < len(groups):
                thick = groups[end][0] != cell
                axis.axvline(end - 0.5, color=style.GREY, linewidth=0.9 if thick else 0.3)
            begin = end
    axis.set_xticks(ticks, labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=7)


def _grid_keys() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=style.BLUE, label="solved (filled by the share of flights)"),
        Patch(facecolor=style.LIGHT, label="not solved"),
        Line2D([], [], marker="x", color=style.VERMILION, linestyle="", markersize=4, label="not scored"),
    ]


GRID = "episode_by_episode"  # which is of no table
OF_TABLES = {  # table → its figure's name, and what draws it
    "approaching": ("reach_declare_succeed", nested),
    "failures": ("failure_modes", modes),
    "drones": ("commanding_by_drone", decomposition),
    "served": ("served_rate", rates),
}


def draw(data: ReportData, made: Sequence[ReportTable], out: Path) -> dict[str, Path]:
    """Draw what there is to draw as SVG, PDF and PNG, and return the PNG of each table, and GRID's.

    Raises InfrastructureError.
    """
    drawn = {}
    with style.styled():
        for table in made:
            if table.name in OF_TABLES and table.rows:
                name, figure = OF_TABLES[table.name]
                drawn[table.name] = style.save(figure(table), out, name)
        if data.episodes:
            drawn[GRID] = style.save(episode_grid(data), out, GRID)
    return drawn
