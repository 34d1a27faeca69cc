"""A table as CSV: every number whole, its interval and its counts in columns of their own."""

import csv
import io

from dronecats.report.report_table import ReportTable, TableCell, TableColumn

BESIDE = ("low", "high", "count", "of")  # what a cell has beside its value


def as_csv(table: ReportTable) -> str:
    """Return the table, a line a row. Of what a cell has beside its value, a column that is empty is left out."""
    shown = [(k, column, field) for k, column in enumerate(table.columns) for field in ("value", *BESIDE)
             if field == "value" or any(getattr(row.cells[k], field) is not None for row in table.rows)]  # fmt: skip
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["block", *(_head(column, field) for _, column, field in shown)])
    for block in table.blocks:
        for row in block.rows:
            writer.writerow([block.title, *(_told(row.cells[k], field) for k, _, field in shown)])
    return text.getvalue()


def _head(column: TableColumn, field: str) -> str:
    return column.name if field == "value" else f"{column.name}_{field}"


def _told(cell: TableCell, field: str) -> str:
    value = getattr(cell, field)
    return "" if value is None else str(value)
