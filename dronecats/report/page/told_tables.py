"""The report's tables as the page has them: words already, so that no number is told in two ways."""

from collections.abc import Mapping
from dataclasses import dataclass

from dronecats.judge.metrics.metric import Better
from dronecats.report.report_table import Align, ReportTable, TableCell, TableColumn, TableRow


@dataclass(frozen=True, slots=True, kw_only=True)
class PageColumn:
    """The head of a column."""

    title: str
    group: str
    unit: str
    better: Better | None
    align: Align
    cell: str | None  # of the grid, to whose flights a value leads


@dataclass(frozen=True, slots=True, kw_only=True)
class PageCell:
    """A value."""

    text: str
    interval: str
    counted: str | None  # 3 of 20
    best: bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageLine:
    """A line."""

    entrant: int | None  # whose flights it leads to; None: nobody's
    cells: tuple[PageCell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageBlock:
    """Lines that may be compared."""

    title: str
    rows: tuple[PageLine, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageTable:
    """A table."""

    title: str
    caption: str
    notes: tuple[str, ...]
    command: str
    columns: tuple[PageColumn, ...]
    blocks: tuple[PageBlock, ...]


def page_table(table: ReportTable, places: Mapping[str, int]) -> PageTable:
    """Return a table for the page; `places` is where on it each entrant stands, by the label."""
    columns = table.columns
    return PageTable(
        title=table.title,
        caption=table.caption,
        notes=table.notes,
        command=table.command,
        columns=tuple(
            PageColumn(title=each.title, group=each.group, unit=each.head_unit, better=each.better, align=each.align,
                       cell=each.cell)
            for each in columns
        ),
        blocks=tuple(
            PageBlock(title=block.title, rows=tuple(_line(row, columns, places) for row in block.rows))
            for block in table.blocks
        ),
    )  # fmt: skip


def _line(row: TableRow, columns: tuple[TableColumn, ...], places: Mapping[str, int]) -> PageLine:
    cells = (_cell(cell, column) for cell, column in zip(row.cells, columns, strict=True))
    return PageLine(entrant=places.get(row.entrant), cells=tuple(cells))


def _cell(cell: TableCell, column: TableColumn) -> PageCell:
    return PageCell(
        text=cell.text(column),
        interval=cell.interval(column),
        counted=f"{cell.count} of {cell.of}" if cell.count is not None and cell.of is not None else None,
        best=cell.best or None,
    )
