"""Draws the figures of the report: three bar figures, the rates of decisions, and the grid of episodes.

The figures fit the width of a page. Their colours are distinguishable in greyscale and for colour-blind readers.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dronecats.report.report_data import (
    BUILT_IN,
    DRONE_OUTCOMES,
    FAILURE_MODE_COLUMNS,
    MODELS,
    OutcomeColumn,
    ReportData,
    cell_heading,
)
from dronecats.report.table import ReportTable, TableCell, TableRow, rounded
from dronecats.report.tables.measures import QUANTILES
from episodes.records.record import CELLS
from foundation.errors import InfrastructureError
from foundation.files import file_errors_as

WIDTH_IN = 6.9  # inches, width of the text on a page
FORMATS = ("svg", "pdf", "png")
# Okabe and Ito's colours, ordered so that neighbours also differ in lightness
BLUE, ORANGE, SKY, VERMILION, GREEN, YELLOW, PURPLE = (
    "#0072B2", "#E69F00", "#56B4E9", "#D55E00", "#009E73", "#F0E442", "#CC79A7",
)  # fmt: skip
INK, GREY, LIGHT = "#222222", "#8C8C8C", "#DDDDDD"
SETTINGS: dict[str, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # TrueType fonts, which publishers require
    "svg.fonttype": "path",
    "svg.hashsalt": "dronecats",  # fixed, so that equal reports give equal files
    "savefig.dpi": 200,
}


FigureLines = list[tuple[TableRow, float]]  # rows of the table with their vertical positions, in lines, downwards


@contextmanager
def styled() -> Iterator[None]:
    """Apply SETTINGS to the figures that are drawn in this context."""
    import matplotlib as mpl

    with mpl.rc_context(SETTINGS):
        yield


def lines(table: ReportTable) -> tuple[FigureLines, list[tuple[str, float]]]:
    """Return a table's rows, and the titles above its blocks of rows, with their vertical positions."""
    rows, heads, y = [], [], 0.0
    for block in table.blocks:
        if block.title:
            heads.append((block.title, y))
            y += 0.8
        for row in block.rows:
            rows.append((row, y))
            y += 1.0
        y += 0.3
    return rows, heads


def canvas(height_in: float, width_in: float = WIDTH_IN) -> Any:
    """Return an empty figure of this size, without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(drawing)
    return drawing


def figure(height_lines: float, line_in: float = 0.26, below_in: float = 0.75) -> tuple[Any, Any]:
    """Return a figure for a number of lines, and its axes."""
    drawing = canvas(height_lines * line_in + below_in)
    return drawing, drawing.add_subplot()


def label_rows(axis: Any, rows: FigureLines, heads: Sequence[tuple[str, float]]) -> None:
    """Write the names of the rows and the titles of the blocks on the left."""
    axis.set_yticks([y for _, y in rows], [str(row.cells[0].value) for row, _ in rows])
    axis.tick_params(axis="y", length=0, pad=6)
    _write_heads(axis, heads, 6)
    bottom = max(y for _, y in rows) + 0.6
    axis.set_ylim(bottom, min([y - 0.6 for _, y in rows] + [y - 0.4 for _, y in heads]))


def _write_heads(axis: Any, heads: Sequence[tuple[str, float]], left_pt: int) -> None:
    """Write titles at their vertical positions, `left_pt` points to the left of the axes."""
    for title, y in heads:
        axis.annotate(title, (0.0, y), xytext=(-left_pt, 0), xycoords=("axes fraction", "data"), ha="right",
                      textcoords="offset points", va="center", style="italic", color=GREY)  # fmt: skip


def save(drawing: Any, out: Path, name: str) -> Path:
    """Write the figure as SVG, PDF and PNG, and return the PNG's path. Raises InfrastructureError if this fails."""
    with file_errors_as(InfrastructureError, f"the figure {out / name} cannot be written"):
        out.mkdir(parents=True, exist_ok=True)
        for kind in FORMATS:
            metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}, "png": {}}[kind]
            drawing.savefig(out / f"{name}.{kind}", metadata=metadata)
    return out / f"{name}.png"


def remove(out: Path, name: str) -> None:
    """Remove the files of a figure, if there are any. Raises InfrastructureError if this fails."""
    with file_errors_as(InfrastructureError, f"the figure {out / name} cannot be removed"):
        for kind in FORMATS:
            (out / f"{name}.{kind}").unlink(missing_ok=True)


NESTED = (  # column of the table, title, colour
    ("approaching_oracle_success_percent", "came within the radius", SKY),
    ("approaching_declared_percent", "declared arrival", ORANGE),
    ("approaching_success_percent", "succeeded", BLUE),
)
MODE_COLOURS = (BLUE, VERMILION, ORANGE, PURPLE, GREEN, SKY, LIGHT, "#FFFFFF")
DRONE_COLOURS = (BLUE, VERMILION, ORANGE, LIGHT)
LABELLED = 7.0  # %, least width of a segment that shows its number


def draw_reach_declare_succeed(table: ReportTable) -> Any:
    """Return the figure of the table `approaching`: how often each row's pilot arrives, declares and succeeds."""
    rows, heads = lines(table)
    drawing, axis = figure(rows[-1][1] + 1.0, line_in=0.36)
    for k, (column, title, colour) in enumerate(NESTED):
        cells = [cell(table, row, column) for row, _ in rows]
        heights = [y + 0.26 * (k - 1) for _, y in rows]
        axis.barh(heights, [number(c) for c in cells], height=0.24, color=colour, label=title)
        for c, y in zip(cells, heights, strict=True):
            if c.low is not None and c.high is not None:
                axis.plot([c.low, c.high], [y, y], color=INK, linewidth=0.9, solid_capstyle="butt")
    label_rows(axis, rows, heads)
    return _in_percent(drawing, axis, "% of the flights of approaching; lines: 95 % intervals")


def draw_failure_modes(table: ReportTable) -> Any:
    """Return the figure of the table `failures`: a bar for each entrant, divided by failure modes."""
    drawing, axis = _stacked(table, FAILURE_MODE_COLUMNS, MODE_COLOURS)
    return _in_percent(drawing, axis, "% of the one-drone flights", 4)


def draw_drone_outcomes(table: ReportTable) -> Any:
    """Return the figure of the table `drones`: outcomes of drones as bars, the episodes won as diamonds."""
    drawing, axis = _stacked(table, DRONE_OUTCOMES, DRONE_COLOURS)
    rows, _ = lines(table)
    won = [number(cell(table, row, "commanding_success_percent")) for row, _ in rows]
    below = [y + 0.36 for _, y in rows]  # on the edge of the bar, so that the bar's number stays readable
    axis.plot(won, below, "D", color="white", markeredgecolor=INK, markersize=4.5, label="Episodes won",
              linestyle="", clip_on=False, zorder=5)  # fmt: skip
    return _in_percent(drawing, axis, "% of the drones; diamonds: % of the episodes")


def cell(table: ReportTable, row: TableRow, name: str) -> TableCell:
    return row.cells[[column_.name for column_ in table.columns].index(name)]


def number(value_cell: TableCell) -> float:
    """Return the number in a cell; 0 without a number."""
    return float(value_cell.value) if isinstance(value_cell.value, int | float) else 0.0


def _stacked(table: ReportTable, outcomes: Sequence[OutcomeColumn], colours: Sequence[str]) -> tuple[Any, Any]:
    """Return a figure with a bar per row, divided by outcomes, and its axes."""
    rows, heads = lines(table)
    drawing, axis = figure(rows[-1][1] + 1.0, below_in=0.95)
    begins = [0.0] * len(rows)
    for outcome, colour in zip(outcomes, colours, strict=True):
        widths = [number(cell(table, row, outcome.column)) for row, _ in rows]
        if not any(widths):
            continue
        axis.barh([y for _, y in rows], widths, left=begins, height=0.72, color=colour, label=outcome.title,
                  edgecolor=GREY if colour == "#FFFFFF" else "white", linewidth=0.6)  # fmt: skip
        dark = colour in (BLUE, VERMILION, GREEN)
        for (_, y), begin, width in zip(rows, begins, widths, strict=True):
            if width >= LABELLED:
                axis.text(begin + width / 2, y, rounded(width, 0), ha="center", va="center", fontsize=7,
                          color="white" if dark else INK)  # fmt: skip
        begins = [begin + width for begin, width in zip(begins, widths, strict=True)]
    label_rows(axis, rows, heads)
    return drawing, axis


def _in_percent(drawing: Any, axis: Any, label: str, legend_columns: int = 3) -> Any:
    """Return a figure with an axis of percentages, and a legend below it."""
    axis.set_xlim(0, 100)
    axis.set_xlabel(label)
    drawing.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=legend_columns)
    return drawing


def rates(table: ReportTable) -> Any:
    """Return the figure of decision rates (table `served`): whiskers 5 to 95 %, boxes 25 to 75 %, lines at medians."""
    rows, heads = lines(table)
    drawing, axis = figure(rows[-1][1] + 1.0, below_in=0.6)
    for row, y in rows:
        values = [cell(table, row, f"rate_{q}_hz").value for q in QUANTILES]
        low, begin, middle, end, high = (float(value) for value in values if isinstance(value, int | float))
        axis.plot([low, high], [y, y], color=INK, linewidth=0.8)
        axis.barh(y, end - begin, left=begin, height=0.5, color=SKY, edgecolor=INK, linewidth=0.6, zorder=3)
        axis.plot([middle, middle], [y - 0.25, y + 0.25], color=INK, linewidth=1.6, zorder=4)
    label_rows(axis, rows, heads)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("decisions per second of vehicle time: 5, 25, 50, 75 and 95 % of the steps")
    return drawing


SIDE = 0.84  # side of a square, as a fraction of the width of a column


def episode_grid(data: ReportData) -> Any:
    """Return the grid: a line per entrant (model or pilot), a column per episode; squares show the success rate."""
    order = {cell: k for k, cell in enumerate(CELLS)}
    episodes = {
        flight.episode: (order.get(flight.cell, len(CELLS)), flight.map, flight.episode) for flight in data.episodes
    }
    columns = sorted(episodes, key=lambda name: episodes[name])
    lines, heads, y = [], [], 0.0
    for title, is_model in ((MODELS, True), (BUILT_IN, False)):
        members = [entrant for entrant in data.entrants if entrant.is_model is is_model]
        if members:
            heads.append((title, y))
            y += 0.9
        for entrant in members:
            lines.append((entrant, y))
            y += 1.0
    drawing, axis = figure(y + 0.5, line_in=0.24, below_in=1.15)
    for entrant, height in lines:
        tried = {flight.episode for flight in entrant.episodes}
        for x, name in enumerate(columns):
            _grid_square(axis, x, height, entrant.by_episode.get(name), name in tried)
    _grid_groups(axis, [(episodes[name][0], episodes[name][1]) for name in columns])
    axis.set_yticks([height for _, height in lines], [entrant.label for entrant, _ in lines])
    axis.tick_params(axis="both", length=0)
    _write_heads(axis, heads, 4)
    axis.set_xlim(-0.7, len(columns) - 0.3)
    axis.set_ylim(y - 0.3, -0.6)
    for spine in axis.spines.values():
        spine.set_visible(False)
    drawing.legend(handles=_grid_keys(), loc="outside lower center", ncols=4)
    return drawing


def _grid_square(axis: Any, x: int, y: float, scored: Any, tried: bool) -> None:
    """Draw the square of an entrant's flights of one episode: a cross if none is scored, nothing without flights."""
    from matplotlib.patches import Rectangle

    if scored:
        share = sum(flight.success for flight in scored) / len(scored)
        filled = SIDE * share  # from the bottom edge
        for top, height, colour in ((-SIDE / 2, SIDE - filled, LIGHT), (SIDE / 2 - filled, filled, BLUE)):
            if height > 0:
                axis.add_patch(Rectangle((x - SIDE / 2, y + top), SIDE, height, facecolor=colour, linewidth=0))
    elif tried:
        axis.plot(x, y, "x", color=VERMILION, markersize=3, markeredgewidth=0.8)


def _grid_groups(axis: Any, groups: list[tuple[int, str]]) -> None:
    """Label the columns by cell (kind of episode) and map, with lines between the groups."""
    ticks, labels = [], []
    begin = 0
    for end in range(1, len(groups) + 1):
        if end == len(groups) or groups[end] != groups[begin]:
            cell, map_ = groups[begin]
            ticks.append((begin + end - 1) / 2)
            labels.append(f"{cell_heading(CELLS[cell]) if cell < len(CELLS) else 'Other'}\n{map_}")
            if end < len(groups):
                thick = groups[end][0] != cell
                axis.axvline(end - 0.5, color=GREY, linewidth=0.9 if thick else 0.3)
            begin = end
    axis.set_xticks(ticks, labels, rotation=45, ha="right", rotation_mode="anchor", fontsize=7)


def _grid_keys() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=BLUE, label="solved (filled by the share of solved flights)"),
        Patch(facecolor=LIGHT, label="not solved"),
        Line2D([], [], marker="x", color=VERMILION, linestyle="", markersize=4, label="not scored"),
    ]


GRID = "episode_by_episode"  # name of the grid figure, which has no table
OF_TABLES = {  # table → name and function of its figure
    "approaching": ("reach_declare_succeed", draw_reach_declare_succeed),
    "failures": ("failure_modes", draw_failure_modes),
    "drones": ("commanding_by_drone", draw_drone_outcomes),
    "served": ("served_rate", rates),
}


def draw(data: ReportData, tables: Sequence[ReportTable], out: Path) -> dict[str, Path]:
    """Draw the figures as SVG, PDF and PNG; return the paths of the PNGs by table name or GRID.

    If an earlier report left figures in `out` that this report does not have, remove them. Raises InfrastructureError
    if a figure cannot be written or removed.
    """
    drawn = {}
    with styled():
        for table in tables:
            if table.name in OF_TABLES and table.rows:
                name, draw_table = OF_TABLES[table.name]
                drawn[table.name] = save(draw_table(table), out, name)
        if data.episodes:
            drawn[GRID] = save(episode_grid(data), out, GRID)
    names = {GRID, *(name for name, _ in OF_TABLES.values())}
    for name in names.difference(path.stem for path in drawn.values()):
        remove(out, name)
    return drawn
