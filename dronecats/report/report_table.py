"""A table of the report as data: typed cells, from which Markdown, LaTeX, CSV and the page are written."""

import math
from dataclasses import dataclass
from typing import Literal

from dronecats.judge.metrics.metric import Better

Align = Literal["left", "right"]
NOTHING = "–"  # what stands where there is nothing to tell


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumn:
    """What stands in a column, and how it is told."""

    name: str  # for CSV and links: a Python name that ends in its unit where it has one, like approaching_sr_percent
    title: str  # its head
    group: str = ""  # a head above several neighbours, like Approaching; empty: none
    unit: str = ""  # of value, low and high: "%", "m", "Hz", "s", "$", …; empty: a count, a ratio or words
    decimals: int = 0  # that are shown; CSV has them all
    better: Better | None = None  # which way is good; None: neither
    align: Align = "right"
    as_count: bool = False  # a share is shown as 7/10, and not as 70 with its interval
    floor: float | None = None  # a value below it is only said to be so, as a p of < 0.001; None: all are shown
    cell: str | None = None  # the cell of the grid that it is of, as records name it; None: of several
    map: str | None = None  # the map, likewise

    @property
    def head_unit(self) -> str:
        """The unit of what is shown: a share that is shown as a count has none."""
        return "" if self.as_count else self.unit


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCell:
    """One value of a row, in its column's unit."""

    value: str | float | None  # None: not known, or not defined
    low: float | None = None  # its interval; None: it has none
    high: float | None = None
    count: int | None = None  # of a share: this many …
    of: int | None = None  # … of this many; of a mean the number of values
    best: bool = False  # the best of its block, or as good

    def text(self, column: TableColumn) -> str:
        """Return the value as people read it, without its interval."""
        if self.value is None:
            return NOTHING
        if isinstance(self.value, str):
            return self.value
        if column.as_count and self.of is not None:
            return f"{self.count}/{self.of}"
        if column.floor is not None and self.value < column.floor:
            return f"< {column.floor:g}"
        return rounded(self.value, column.decimals)

    def interval(self, column: TableColumn) -> str:
        """Return its interval as people read it, without brackets; empty: it has none."""
        if self.low is None or self.high is None or column.as_count:
            return ""
        between = " to " if self.low < 0 else "–"  # a dash before a minus is read as neither
        return f"{rounded(self.low, column.decimals)}{between}{rounded(self.high, column.decimals)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """A line of a table: a cell for each of its columns."""

    cells: tuple[TableCell, ...]
    entrant: str = ""  # label of whose line it is, as in `results.entrants`; empty: nobody's, or several's


@dataclass(frozen=True, slots=True, kw_only=True)
class TableBlock:
    """Lines that may be compared: models stand in one, built-in pilots in another."""

    title: str  # what they are, above them; empty: nothing above
    rows: tuple[TableRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """A table with all that its reader needs. The first column names the line."""

    name: str  # of its files: main, per_map, …
    title: str
    caption: str  # what is counted, over how many, in sentences
    columns: tuple[TableColumn, ...]
    blocks: tuple[TableBlock, ...]
    notes: tuple[str, ...] = ()  # beneath it, a sentence each
    command: str = ""  # the command line that makes it

    def __post_init__(self) -> None:
        """Raise ValueError when a line has another number of cells than there are columns."""
        for row in self.rows:
            if len(row.cells) != len(self.columns):
                raise ValueError(f"table {self.name}: {len(row.cells)} cells in a line of {len(self.columns)} columns")

    @property
    def rows(self) -> tuple[TableRow, ...]:
        """All lines, whatever block they are in."""
        return tuple(row for block in self.blocks for row in block.rows)


def rounded(value: float, decimals: int) -> str:
    """Return a number with so many decimals, halves away from zero as people round: 12.5 is 13, and not Python's 12.

    What rounds to nought has no sign.
    """
    told = f"{value + math.copysign(1e-9, value):.{decimals}f}"
    return told if float(told) else told.removeprefix("-")
