"""A table as Markdown: heads with their groups, blocks as lines of their own, the best in bold."""

import re
from collections.abc import Iterable

from dronecats.report.report_table import ReportTable, TableBlock, TableCell, TableColumn

SPECIAL = re.compile(r"([\\`*_\[\]<>|#])")


def as_markdown(table: ReportTable, level: int = 2) -> str:
    """Return the table with its title as a head of this level, caption and notes."""
    lines = [f"{'#' * level} {escaped(table.title)}", "", escaped(table.caption), ""]
    lines.append(_line(_head(column) for column in table.columns))
    lines.append(_line("---:" if column.align == "right" else ":---" for column in table.columns))
    for block in table.blocks:
        lines += _block(block, table.columns)
    for note in table.notes:
        lines += ["", escaped(note)]
    return "\n".join(lines) + "\n"


def as_shell(commands: Iterable[str]) -> str:
    """Return a fenced block of shell commands."""
    return "\n".join(["```sh", *commands, "```"]) + "\n"


def escaped(text: str) -> str:
    """Return the text so that Markdown shows it as it is."""
    return SPECIAL.sub(r"\\\1", " ".join(text.split()))


def _block(block: TableBlock, columns: tuple[TableColumn, ...]) -> list[str]:
    title = [_line([f"*{escaped(block.title)}*", *[""] * (len(columns) - 1)])] if block.title else []
    rows = [_line(_cell(c, column) for c, column in zip(row.cells, columns, strict=True)) for row in block.rows]
    return [*title, *rows]


def _cell(cell: TableCell, column: TableColumn) -> str:
    text = escaped(cell.text(column))
    bold = f"**{text}**" if cell.best else text
    interval = cell.interval(column)
    return f"{bold} ({interval})" if interval else bold


def _head(column: TableColumn) -> str:
    unit = f" ({column.head_unit})" if column.head_unit not in ("", "%", "$") else ""
    return escaped(f"{column.group} {column.title}{unit}".strip())


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
