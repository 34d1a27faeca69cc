"""How figures look: small enough for a page's width, told apart in grey and by eyes that see no red."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report.table import ReportTable, TableRow
from foundation.errors import InfrastructureError

WIDTH_IN = 6.9  # a page's text, in inches
FORMATS = ("svg", "pdf", "png")
# Okabe and Ito's colours, in an order in which neighbours differ in lightness too
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
    "pdf.fonttype": 42,  # text as text, which a publisher wants
    "svg.fonttype": "path",
    "svg.hashsalt": "dronecats",  # the same report twice is the same file
    "savefig.dpi": 200,
}


@dataclass(frozen=True, slots=True)
class FigureLine:
    """A line of a figure: a row of its table at a height."""

    row: TableRow
    y: float  # downwards, in lines


@contextmanager
def styled() -> Iterator[None]:
    """Draw in this style."""
    import matplotlib as mpl

    with mpl.rc_context(SETTINGS):
        yield


def lines(table: ReportTable) -> tuple[list[FigureLine], list[tuple[str, float]]]:
    """Return the rows at their heights, and the blocks' titles at theirs: a head's room above each block."""
    found, heads, y = [], [], 0.0
    for block in table.blocks:
        if block.title:
            heads.append((block.title, y))
            y += 0.8
        for row in block.rows:
            found.append(FigureLine(row, y))
            y += 1.0
        y += 0.3
    return found, heads


def canvas(height_in: float, width_in: float = WIDTH_IN) -> Any:
    """Return an empty figure of this size, which needs no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(made)
    return made


def figure(height_lines: float, line_in: float = 0.26, below_in: float = 0.75) -> tuple[Any, Any]:
    """Return a figure for so many lines, and its one axis."""
    made = canvas(height_lines * line_in + below_in)
    return made, made.add_subplot()


def named(axis: Any, found: Sequence[FigureLine], heads: Sequence[tuple[str, float]]) -> None:
    """Write the lines' names and the blocks' titles on the left."""
    axis.set_yticks([line.y for line in found], [str(line.row.cells[0].value) for line in found])
    axis.tick_params(axis="y", length=0, pad=6)
    for title, y in heads:
        axis.annotate(title, (0.0, y), xytext=(-6, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
                      ha="right", va="center", style="italic", color=GREY)  # fmt: skip
    bottom = max(line.y for line in found) + 0.6
    axis.set_ylim(bottom, min([line.y - 0.6 for line in found] + [y - 0.4 for _, y in heads]))


def save(made: Any, out: Path, name: str) -> Path:
    """Write the figure as SVG, PDF and PNG, and return the PNG's path. Raises InfrastructureError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for kind in FORMATS:
            told = {"svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}, "png": {}}[kind]
            made.savefig(out / f"{name}.{kind}", metadata=told)
    except OSError as full:
        raise InfrastructureError(f"the figure {out / name} cannot be written: {full.strerror}") from None
    return out / f"{name}.png"
