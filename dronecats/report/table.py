"""Tables as data, with typed cells. `writers` formats them for terminals, Markdown, CSV, JSON, HTML and LaTeX."""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:  # the metrics import numpy, and `dronecats doctor` prints tables without it
    from dronecats.judge.metrics.metric import Better

Align = Literal["left", "right"]
CellValue = str | float | None
NOTHING = "–"  # the text of a cell without a value
SILENT_UNITS = ("", "%", "$")  # units that a column's head omits


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumn:
    """The content of a column, and the format of its values."""

    name: str  # in CSV, JSON and links: a Python name that ends in its unit, such as approaching_sr_percent
    title: str  # title of the column
    group: str = ""  # a head above neighbouring columns, such as Approaching; empty: none
    unit: str = ""  # of value, low and high: "%", "m", "Hz", "s", "$", …; empty: a count, a ratio or words
    decimals: int = 0  # number of decimals shown; CSV has all digits
    better: "Better | None" = None  # the better direction; None: neither
    align: Align = "right"
    as_count: bool = False  # show a share as 7/10, not as 70 with its interval
    floor: float | None = None  # a smaller value is shown as `< floor`, such as p < 0.001; None: no floor
    cell: str | None = None  # cell (kind of episode) of the column's values, as in episode records; None: several
    map: str | None = None  # map of the column's values; None: several
    code: bool = False  # the column's values are identifiers, which Markdown shows as code

    @property
    def head_unit(self) -> str:
        """The unit of the shown values. A share that is shown as a count has no unit."""
        return "" if self.as_count else self.unit

    @property
    def head(self) -> str:
        """The title, with the unit unless SILENT_UNITS contains it."""
        return f"{self.title} ({self.head_unit})" if self.head_unit not in SILENT_UNITS else self.title


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCell:
    """One value of a row, in its column's unit."""

    value: CellValue  # None: unknown or undefined
    low: float | None = None  # lower end of the interval; None: no interval
    high: float | None = None  # upper end of the interval
    count: int | None = None  # numerator of a share
    of: int | None = None  # denominator of a share; number of values of a mean
    best: bool = False  # the best value of the column in the row's block; equal values are all best
    link: str = ""  # address that the cell links to in Markdown and HTML

    def text(self, column: TableColumn) -> str:
        """Return the value as text, without its interval."""
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
        """Return the interval as text, without brackets; empty: no interval, or a share shown as a count."""
        if self.low is None or self.high is None or column.as_count:
            return ""
        between = " to " if self.low < 0 else "–"  # a dash before a minus sign is hard to read
        return f"{rounded(self.low, column.decimals)}{between}{rounded(self.high, column.decimals)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """A row of a table: a cell for each of its columns."""

    cells: tuple[TableCell, ...]
    entrant: str = ""  # label of the row's entrant, as in `report_data.entrants`; empty: none or several


@dataclass(frozen=True, slots=True, kw_only=True)
class TableBlock:
    """Rows that may be compared: models are in one block, built-in pilots in another."""

    title: str  # shown above the rows; empty: none
    rows: tuple[TableRow, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportTable:
    """A table with title, caption and notes. The first column names the row."""

    name: str = ""  # name of the table's files: main, per_map, …
    title: str = ""
    caption: str = ""  # sentences
    columns: tuple[TableColumn, ...]
    blocks: tuple[TableBlock, ...]
    notes: tuple[str, ...] = ()  # sentences below the table
    command: str = ""  # the command line that makes the table

    def __post_init__(self) -> None:
        """Raise ValueError when a row does not have one cell per column."""
        for row in self.rows:
            if len(row.cells) != len(self.columns):
                raise ValueError(f"table {self.name}: {len(row.cells)} cells in a row of {len(self.columns)} columns")

    @property
    def rows(self) -> tuple[TableRow, ...]:
        """The rows of all blocks."""
        return tuple(row for block in self.blocks for row in block.rows)


def groups(columns: Iterable[TableColumn]) -> list[tuple[str, int]]:
    """Return (group, number of its columns) from left to right; the group is '' for columns without one."""
    return [(group, len(list(members))) for group, members in itertools.groupby(columns, lambda column: column.group)]


def words(title: str, name: str = "") -> TableColumn:
    """Return a column of words. The default of `name` is `title`."""
    return TableColumn(name=name or title, title=title, align="left")


def numbers(title: str, name: str = "", *, unit: str = "", decimals: int = 0, group: str = "") -> TableColumn:
    """Return a column of numbers, or of texts aligned as numbers."""
    return TableColumn(name=name or title, title=title, unit=unit, decimals=decimals, group=group)


def row(*values: CellValue | TableCell, entrant: str = "") -> TableRow:
    """Return a row of plain values and cells."""
    cells = (value if isinstance(value, TableCell) else TableCell(value=value) for value in values)
    return TableRow(cells=tuple(cells), entrant=entrant)


def in_blocks(titled: Iterable[tuple[str, TableRow]]) -> tuple[TableBlock, ...]:
    """Return a block of rows for each title, in the order of the titles."""
    blocks: dict[str, list[TableRow]] = {}
    for title, of_it in titled:
        blocks.setdefault(title, []).append(of_it)
    return tuple(TableBlock(title=title, rows=tuple(rows)) for title, rows in blocks.items())


def table_of(
    columns: Iterable[TableColumn], lines: Iterable[Sequence[CellValue | TableCell]], *notes: str
) -> ReportTable:
    """Return a table of plain values and cells in one block."""
    rows = tuple(row(*line) for line in lines)
    return ReportTable(columns=tuple(columns), blocks=(TableBlock(title="", rows=rows),), notes=notes)


def rounded(value: float, decimals: int) -> str:
    """Return a number with these decimals, halves rounded away from zero: 12.5 is 13, not Python's 12.

    A value that rounds to zero has no sign.
    """
    text = f"{value + math.copysign(1e-9, value):.{decimals}f}"
    return text if float(text) else text.removeprefix("-")
