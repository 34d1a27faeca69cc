"""Writes a table for a terminal and as Markdown, CSV, JSON and HTML. LaTeX has a module of its own, `latex`."""

import csv
import html
import io
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from dronecats.report.table import ReportTable, TableBlock, TableCell, TableColumn, groups

GAP = 2  # characters between two columns of a terminal
NARROWEST, LONG_WORD = 16, 24  # characters that a column of words keeps when a table is too wide
BREAK = re.compile(r"(?<=\s)|(?<=/)|(?<=\w-)")  # where a line of words may be broken
BESIDE = ("low", "high", "count", "of")  # fields of a cell beside its value, which CSV has too
MARKUP = re.compile(r"([\\`*_\[\]<>|#{}!~&])")
SHORT = 45  # letters of words that HTML does not break


def as_terminal(table: ReportTable, width: int | None = None) -> str:
    """Return the table as lines of at most `width` characters; None: as wide as it is.

    Where it is too wide, heads and words are wrapped. Where that is not enough, columns continue below, each part with
    the first column.
    """
    lines = [table.title] if table.title else []
    lines += _filled(table.caption, width)
    body = _Text(table)
    for number, part in enumerate(body.parts(width)):
        lines += [""] if number or (lines and body.has_heads) else []
        lines += body.lines(part, width)
    for note in table.notes:
        lines += _filled(note, width)
    return "\n".join(line.rstrip() for line in lines)


class _Text:
    """The texts of a table, and the widths that its columns need on a terminal."""

    def __init__(self, table: ReportTable) -> None:
        self.columns = table.columns
        self.has_heads = any(column.head for column in table.columns)
        indent = "  " if any(block.title for block in table.blocks) else ""
        self.blocks = [
            (block.title, [[_lined(k, cell, column, indent) for k, (cell, column) in enumerate(
                zip(row.cells, table.columns, strict=True))] for row in block.rows])
            for block in table.blocks
        ]  # fmt: skip
        rows = [row for _, rows in self.blocks for row in rows]
        in_cells = [max((len(line) for row in rows for line in row[k]), default=0) for k in range(len(self.columns))]
        heads = [len(column.head) for column in self.columns]
        words = [max(map(len, column.head.split()), default=0) for column in self.columns]
        self.widest = [max(pair) for pair in zip(in_cells, heads, strict=True)]
        self.narrowest = [
            max(word, min(cell, max(NARROWEST, self._longest_word(k))) if column.align == "left" else cell)
            for k, (word, cell, column) in enumerate(zip(words, in_cells, self.columns, strict=True))
        ]

    def _longest_word(self, number: int) -> int:
        """Return the length of a column's longest word, or LONG_WORD where that is shorter."""
        lines = (line for _, rows in self.blocks for row in rows for line in row[number])
        return min(LONG_WORD, max((len(word.rstrip()) for line in lines for word in BREAK.split(line)), default=0))

    def parts(self, width: int | None) -> list[list[int]]:
        """Return the columns of each part, by their numbers."""
        found = [[0]] if self.columns else []
        for k in range(1, len(self.columns)):
            longer = [*found[-1], k]
            if width is not None and len(found[-1]) > 1 and _total(self._grouped(self.narrowest, longer)) > width:
                longer = [0, k]
                found.append(longer)
            found[-1] = longer
        return found

    def lines(self, part: Sequence[int], width: int | None) -> list[str]:
        """Return heads and rows of these columns."""
        widths = self._widths(part, width)
        columns = [self.columns[k] for k in part]
        lines = []
        if any(column.group for column in columns):
            lines.append(_group_line(columns, widths))
        if self.has_heads:
            lines += _head_lines(columns, widths)
            lines.append(" ".join(["─" * size + " " * (GAP - 1) for size in widths]))
        for title, rows in self.blocks:
            lines += [title] if title else []
            for row in rows:
                lines += _joined([row[k] for k in part], columns, widths)
        return lines

    def _widths(self, part: Sequence[int], width: int | None) -> list[int]:
        """Return the columns' widths: what they need where there is room, else the first column's need and a share."""
        widest, narrowest = self._grouped(self.widest, part), self._grouped(self.narrowest, part)
        if width is None or _total(widest) <= width:
            return widest
        left = max(0, width - _total(narrowest))
        widths = list(narrowest)
        name = min(widest[0] - narrowest[0], left)  # a name in one piece tells rows apart at a glance
        widths[0], left = widths[0] + name, left - name
        wanting = sorted(range(1, len(part)), key=lambda k: widest[k] - narrowest[k])
        for place, k in enumerate(wanting):
            more = min(widest[k] - narrowest[k], left // (len(wanting) - place))
            widths[k] += more
            left -= more
        return widths

    def _grouped(self, widths: Sequence[int], part: Sequence[int]) -> list[int]:
        """Return the widths of a part, wide enough for the heads of its groups."""
        found = [widths[k] for k in part]
        end = 0
        for group, count in groups([self.columns[k] for k in part]):
            end += count
            found[end - 1] += max(0, len(group) - _total(found[end - count : end])) if group else 0
        return found


def _lined(number: int, cell: TableCell, column: TableColumn, indent: str) -> list[str]:
    interval = cell.interval(column)
    text = f"{cell.text(column)} ({interval})" if interval else cell.text(column)
    return [f"{'' if number else indent}{line}" for line in text.split("\n")]


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + GAP * (len(widths) - 1)


def _head_lines(columns: Sequence[TableColumn], widths: Sequence[int]) -> list[str]:
    """Return the heads, broken at blanks alone, the short ones at the bottom."""
    wrapped = [textwrap.wrap(column.head, max(1, size)) for column, size in zip(columns, widths, strict=True)]
    high = max(map(len, wrapped))
    return _beside([[""] * (high - len(head)) + head for head in wrapped], columns, widths)


def _joined(cells: Sequence[list[str]], columns: Sequence[TableColumn], widths: Sequence[int]) -> list[str]:
    """Return cells beside one another, wrapped to their widths."""
    sized = zip(cells, widths, strict=True)
    wrapped = [[part for line in cell for part in _wrapped(line, size)] for cell, size in sized]
    high = max(map(len, wrapped))
    return _beside([cell + [""] * (high - len(cell)) for cell in wrapped], columns, widths)


def _beside(cells: Sequence[list[str]], columns: Sequence[TableColumn], widths: Sequence[int]) -> list[str]:
    """Return cells of as many lines each as lines, numbers to the right."""
    return [
        (" " * GAP).join(
            text.rjust(size) if column.align == "right" else text.ljust(size)
            for text, column, size in zip(line, columns, widths, strict=True)
        )
        for line in zip(*cells, strict=True)
    ]


def _group_line(columns: Sequence[TableColumn], widths: Sequence[int]) -> str:
    heads, end = [], 0
    for group, count in groups(columns):
        span = _total(widths[end : end + count])
        heads.append(f" {group} ".center(span, "─")[:span] if group and span > len(group) + 1 else group.ljust(span))
        end += count
    return (" " * GAP).join(heads)


def _wrapped(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()))
    lines = [""]
    for word in BREAK.split(line):
        if lines[-1].strip() and len(lines[-1]) + len(word.rstrip()) > width:
            lines.append(indent)
        lines[-1] += word
        while len(lines[-1].rstrip()) > width:  # a word that is longer than a line
            lines[-1:] = [lines[-1][:width], indent + lines[-1][width:]]
    return [each.rstrip() for each in lines]


def _filled(text: str, width: int | None) -> list[str]:
    return _wrapped(text, width) if text and width else [text] if text else []


def as_markdown(table: ReportTable, level: int = 2) -> str:
    """Return the table with its title as a head of this level, caption and notes."""
    lines = [f"{'#' * level} {escaped(table.title)}", ""] if table.title else []
    lines += [escaped(table.caption), ""] if table.caption else []
    lines.append(_markdown_line(_markdown_head(column) for column in table.columns))
    lines.append(_markdown_line("---:" if column.align == "right" else ":---" for column in table.columns))
    for block in table.blocks:
        lines += _markdown_block(block, table.columns)
    for note in table.notes:
        lines += ["", escaped(note)]
    return "\n".join(lines) + "\n"


def as_shell(commands: Iterable[str]) -> str:
    """Return a fenced block of shell commands."""
    return "\n".join(["```sh", *commands, "```"]) + "\n"


def escaped(text: str) -> str:
    """Return the text so that Markdown shows it as it is: no link, table, heading or HTML comes out of it."""
    plain = "".join(letter if letter.isprintable() else "�" for letter in " ".join(text.split()))
    return MARKUP.sub(r"\\\1", plain).replace("://", ":\\//")


def _markdown_block(block: TableBlock, columns: tuple[TableColumn, ...]) -> list[str]:
    title = [_markdown_line([f"*{escaped(block.title)}*", *[""] * (len(columns) - 1)])] if block.title else []
    rows = [
        _markdown_line(_markdown_cell(cell, column) for cell, column in zip(row.cells, columns, strict=True))
        for row in block.rows
    ]
    return [*title, *rows]


def _markdown_cell(cell: TableCell, column: TableColumn) -> str:
    plain = " ".join(cell.text(column).split())
    text = f"`{plain.replace('`', '').replace('|', '∣')}`" if column.code and plain else escaped(plain)
    text = f"[{text}]({cell.link})" if cell.link else text
    text = f"**{text}**" if cell.best else text
    interval = cell.interval(column)
    return f"{text} ({interval})" if interval else text


def _markdown_head(column: TableColumn) -> str:
    return escaped(f"{column.group} {column.head}".strip())


def _markdown_line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def as_csv(table: ReportTable) -> str:
    """Return the table, a line per row, every number with all its digits; interval and counts in columns of their own.

    A column for an interval or a count that is empty in every row is omitted.
    """
    shown = [(k, column, field) for k, column in enumerate(table.columns) for field in ("value", *BESIDE)
             if field == "value" or any(getattr(row.cells[k], field) is not None for row in table.rows)]  # fmt: skip
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["block", *(c.name if field == "value" else f"{c.name}_{field}" for _, c, field in shown)])
    for block in table.blocks:
        for row in block.rows:
            values = (getattr(row.cells[k], field) for k, _, field in shown)
            writer.writerow([block.title, *("" if value is None else str(value) for value in values)])
    return text.getvalue()


def as_json(tables: Iterable[ReportTable]) -> dict[str, Any]:
    """Return the tables as `--json` prints them: by name, a list of rows by the columns' names."""
    return {
        table.name: [
            {"block": block.title, **{c.name: cell.value for c, cell in zip(table.columns, row.cells, strict=True)}}
            for block in table.blocks
            for row in block.rows
        ]
        for table in tables
    }


def as_html(table: ReportTable) -> str:
    """Return the table, its caption and notes; it scrolls in a box where it is wider than the page."""
    lines = [
        f'<div class="box"><p class="caption">{html.escape(table.caption)}</p>',
        f'<div class="wide" tabindex="0" role="region" aria-label="{html.escape(table.title)}"><table>',
        "<thead>",
        *_html_heads(table.columns),
        "</thead>",
    ]
    for block in table.blocks:
        lines.append("<tbody>")
        if block.title:
            head = f'<th class="block" scope="rowgroup" colspan="{len(table.columns)}">'
            lines.append(f"<tr>{head}<span>{html.escape(block.title)}</span></th></tr>")
        for row in block.rows:
            pairs = enumerate(zip(row.cells, table.columns, strict=True))
            lines.append(f"<tr>{''.join(_html_cell(cell, column, k) for k, (cell, column) in pairs)}</tr>")
        lines.append("</tbody>")
    lines.append("</table></div></div>")
    lines += [f'<p class="quiet">{html.escape(note)}</p>' for note in table.notes]
    return "\n".join(lines)


def _html_heads(columns: Sequence[TableColumn]) -> Iterator[str]:
    if any(column.group for column in columns):
        first = [] if columns[0].group else [("", 1)]  # the first column stays when the others are scrolled
        heads = [
            f'<th class="group" scope="colgroup" colspan="{count}">{html.escape(group)}</th>'
            if group else f'<td colspan="{count}"></td>'
            for group, count in (*first, *groups(columns[len(first) :]))
        ]  # fmt: skip
        yield f"<tr>{''.join(heads)}</tr>"
    arrow = {"more": "\u00a0↑", "less": "\u00a0↓", None: ""}  # behind a space that no line is broken at
    heads = []
    for column in columns:
        unit = f"\u00a0<small>{html.escape(column.head_unit)}</small>" if column.head_unit else ""
        side = ' class="number"' if column.align == "right" else ""
        heads.append(f'<th scope="col"{side}>{html.escape(column.title)}{arrow[column.better]}{unit}</th>')
    yield f"<tr>{''.join(heads)}</tr>"


def _html_cell(cell: TableCell, column: TableColumn, number: int) -> str:
    text = html.escape(cell.text(column))
    kinds = ["number"] if column.align == "right" else ["short-words"] if number and len(text) <= SHORT else []
    kinds += ["best"] if cell.best else []
    if cell.link:
        text = f'<a href="{html.escape(cell.link)}">{text}</a>'
    if interval := cell.interval(column):
        text += f" <small>{html.escape(interval)}</small>"
    tag, attributes = ("td", "") if number else ("th", ' scope="row"')
    attributes += f' class="{" ".join(kinds)}"' if kinds else ""
    attributes += f' title="{cell.count} of {cell.of}"' if cell.count is not None and cell.of is not None else ""
    return f"<{tag}{attributes}>{text}</{tag}>"
