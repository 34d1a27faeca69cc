"""Writes a table for a terminal and as Markdown, CSV, JSON, HTML and LaTeX.

The LaTeX code needs `\\usepackage{booktabs,graphicx}`. It scales a wide table to fit, and continues a long table in
further floats with the same number. (`longtable` does not work in two columns, and cannot be scaled to fit.)
"""

import csv
import html
import io
import itertools
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from dronecats.report.table import NOTHING, ReportTable, TableBlock, TableCell, TableColumn, groups

GAP = 2  # characters between two columns of a terminal
NARROWEST = 16  # characters, least width of a column of words
LONG_WORD = 24  # characters; a column is at least as wide as its longest word, up to this
BREAK = re.compile(r"(?<=\s)|(?<=/)|(?<=\w-)")  # where a line of words may be broken
EXTRA_CSV_FIELDS = ("low", "high", "count", "of")  # further fields of a cell in CSV
MARKUP = re.compile(r"([\\`*_\[\]<>|#{}!~&])")
UNBROKEN_CHARS = 45  # characters of the longest text that HTML does not break


def as_terminal(table: ReportTable, width: int | None = None) -> str:
    """Return the table as text with lines of at most `width` characters; None: no limit.

    If a table is too wide, heads and words are wrapped. If it is still too wide, its columns are divided into parts,
    which follow one below the other. Each part repeats the first column.
    """
    lines = [table.title] if table.title else []
    lines += _filled(table.caption, width)
    body = _TerminalTable(table)
    for number, part in enumerate(body.column_groups(width)):
        lines += [""] if number or (lines and body.has_heads) else []
        lines += body.lines(part, width)
    for note in table.notes:
        lines += _filled(note, width)
    return "\n".join(line.rstrip() for line in lines)


class _TerminalTable:
    """The texts of a table, and the widths that its columns need on a terminal."""

    def __init__(self, table: ReportTable) -> None:
        self.columns = table.columns
        self.has_heads = any(column.head for column in table.columns)
        indent = "  " if any(block.title for block in table.blocks) else ""
        self.blocks = [
            (block.title, [[_cell_lines(k, cell, column, indent) for k, (cell, column) in enumerate(
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
        """Return the length of a column's longest word, at most LONG_WORD."""
        lines = (line for _, rows in self.blocks for row in rows for line in row[number])
        return min(LONG_WORD, max((len(word.rstrip()) for line in lines for word in BREAK.split(line)), default=0))

    def column_groups(self, width: int | None) -> list[list[int]]:
        """Return the column numbers of each part of the table, left to right."""
        column_lists = [[0]] if self.columns else []
        for k in range(1, len(self.columns)):
            columns = [*column_lists[-1], k]
            if (
                width is not None
                and len(column_lists[-1]) > 1
                and _total(self._grouped(self.narrowest, columns)) > width
            ):
                columns = [0, k]
                column_lists.append(columns)
            column_lists[-1] = columns
        return column_lists

    def lines(self, part: Sequence[int], width: int | None) -> list[str]:
        """Return the lines of one part: the heads and rows of its columns."""
        widths = self._widths(part, width)
        columns = [self.columns[k] for k in part]
        lines = []
        if any(column.group for column in columns):
            lines.append(_group_line(columns, widths))
        if self.has_heads:
            heads = [textwrap.wrap(column.head, max(1, size)) for column, size in zip(columns, widths, strict=True)]
            high = max(map(len, heads))
            lines += _merge_lines([[""] * (high - len(head)) + head for head in heads], columns, widths)
            lines.append(" ".join(["─" * size + " " * (GAP - 1) for size in widths]))
        for title, rows in self.blocks:
            lines += [title] if title else []
            for row in rows:
                sized = zip((row[k] for k in part), widths, strict=True)
                cells = [[text for line in cell for text in _wrapped(line, size)] for cell, size in sized]
                lines += _merge_lines(cells, columns, widths)
        return lines

    def _widths(self, part: Sequence[int], width: int | None) -> list[int]:
        """Return the widths of the columns. If space is short, the first column has priority."""
        widest, narrowest = self._grouped(self.widest, part), self._grouped(self.narrowest, part)
        if width is None or _total(widest) <= width:
            return widest
        left = max(0, width - _total(narrowest))
        widths = list(narrowest)
        name = min(widest[0] - narrowest[0], left)  # rows are easier to find if their names are not wrapped
        widths[0], left = widths[0] + name, left - name
        wanting = sorted(range(1, len(part)), key=lambda k: widest[k] - narrowest[k])
        for place, k in enumerate(wanting):
            more = min(widest[k] - narrowest[k], left // (len(wanting) - place))
            widths[k] += more
            left -= more
        return widths

    def _grouped(self, widths: Sequence[int], part: Sequence[int]) -> list[int]:
        """Return the widths of a part's columns, widened if the head of a group needs it."""
        needed = [widths[k] for k in part]
        end = 0
        for group, count in groups([self.columns[k] for k in part]):
            end += count
            needed[end - 1] += max(0, len(group) - _total(needed[end - count : end])) if group else 0
        return needed


def _cell_lines(number: int, cell: TableCell, column: TableColumn, indent: str) -> list[str]:
    interval = cell.interval(column)
    text = f"{cell.text(column)} ({interval})" if interval else cell.text(column)
    return [f"{'' if number else indent}{line}" for line in text.split("\n")]


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + GAP * (len(widths) - 1)


def _merge_lines(cells: Sequence[list[str]], columns: Sequence[TableColumn], widths: Sequence[int]) -> list[str]:
    """Return the lines of cells side by side, with numbers aligned right."""
    return [
        (" " * GAP).join(
            text.rjust(size) if column.align == "right" else text.ljust(size)
            for text, column, size in zip(line, columns, widths, strict=True)
        )
        for line in itertools.zip_longest(*cells, fillvalue="")
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
    return [line.rstrip() for line in lines]


def _filled(text: str, width: int | None) -> list[str]:
    return _wrapped(text, width) if text and width else [text] if text else []


def as_markdown(table: ReportTable, level: int = 2) -> str:
    """Return the table with its title as a heading of this level, its caption and its notes."""
    lines = [f"{'#' * level} {escaped(table.title)}", ""] if table.title else []
    lines += [escaped(table.caption), ""] if table.caption else []
    lines.append(_markdown_line(escaped(f"{column.group} {column.head}".strip()) for column in table.columns))
    lines.append(_markdown_line("---:" if column.align == "right" else ":---" for column in table.columns))
    for block in table.blocks:
        if block.title:
            lines.append(_markdown_line([f"*{escaped(block.title)}*", *[""] * (len(table.columns) - 1)]))
        for row in block.rows:
            pairs = zip(row.cells, table.columns, strict=True)
            lines.append(_markdown_line(_markdown_cell(cell, column) for cell, column in pairs))
    for note in table.notes:
        lines += ["", escaped(note)]
    return "\n".join(lines) + "\n"


def as_shell(commands: Iterable[str]) -> str:
    return "\n".join(["```sh", *commands, "```"]) + "\n"


def escaped(text: str) -> str:
    """Return the text escaped for Markdown: it makes no link, table, heading or HTML."""
    plain = "".join(letter if letter.isprintable() else "�" for letter in " ".join(text.split()))
    return MARKUP.sub(r"\\\1", plain).replace("://", ":\\//")


def _markdown_cell(cell: TableCell, column: TableColumn) -> str:
    plain = " ".join(cell.text(column).split())
    text = f"`{plain.replace('`', '').replace('|', '∣')}`" if column.code and plain else escaped(plain)
    text = f"[{text}]({cell.link})" if cell.link else text
    text = f"**{text}**" if cell.best else text
    interval = cell.interval(column)
    return f"{text} ({interval})" if interval else text


def _markdown_line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def as_csv(table: ReportTable) -> str:
    """Return the table, a line per row, with all digits. Blocks, intervals and counts have their own columns.

    A column for an interval or a count is omitted if it is empty in every row.
    """
    shown = [(k, column, field) for k, column in enumerate(table.columns) for field in ("value", *EXTRA_CSV_FIELDS)
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
    """Return the tables for `--json`: {table name: rows}, where a row maps column names to values."""
    return {
        table.name: [
            {"block": block.title, **{c.name: cell.value for c, cell in zip(table.columns, row.cells, strict=True)}}
            for block in table.blocks
            for row in block.rows
        ]
        for table in tables
    }


def as_html(table: ReportTable) -> str:
    """Return the table, its caption and notes; a table wider than the page scrolls in a box."""
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
        first = [] if columns[0].group else [("", 1)]  # a separate cell, because the first column does not scroll
        heads = [
            f'<th class="group" scope="colgroup" colspan="{count}">{html.escape(group)}</th>'
            if group else f'<td colspan="{count}"></td>'
            for group, count in (*first, *groups(columns[len(first) :]))
        ]  # fmt: skip
        yield f"<tr>{''.join(heads)}</tr>"
    arrow = {"more": "\u00a0↑", "less": "\u00a0↓", None: ""}  # after a no-break space
    heads = []
    for column in columns:
        unit = f"\u00a0<small>{html.escape(column.head_unit)}</small>" if column.head_unit else ""
        side = ' class="number"' if column.align == "right" else ""
        heads.append(f'<th scope="col"{side}>{html.escape(column.title)}{arrow[column.better]}{unit}</th>')
    yield f"<tr>{''.join(heads)}</tr>"


def _html_cell(cell: TableCell, column: TableColumn, number: int) -> str:
    text = html.escape(cell.text(column))
    kinds = ["number"] if column.align == "right" else ["short-words"] if number and len(text) <= UNBROKEN_CHARS else []
    kinds += ["best"] if cell.best else []
    if cell.link:
        text = f'<a href="{html.escape(cell.link)}">{text}</a>'
    if interval := cell.interval(column):
        text += f" <small>{html.escape(interval)}</small>"
    tag, attributes = ("td", "") if number else ("th", ' scope="row"')
    attributes += f' class="{" ".join(kinds)}"' if kinds else ""
    attributes += f' title="{cell.count} of {cell.of}"' if cell.count is not None and cell.of is not None else ""
    return f"<{tag}{attributes}>{text}</{tag}>"


SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "–": "--", "−": "$-$", "α": r"$\alpha$", "δ": r"$\delta$",
    "°": r"$^\circ$", "≤": r"$\le$", "≥": r"$\ge$", "·": r"$\cdot$", "₁": "$_1$", "₃": "$_3$", "×": r"$\times$",
    "<": "$<$", ">": "$>$", "|": "$|$",
}  # fmt: skip

FLOAT_LINES_MAX = 40  # lines, including block titles; with a caption of ten lines they fit on A4 and letter pages
SHRINK_IF_TOO_WIDE = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"


def as_latex(table: ReportTable) -> str:
    """Return the table environment with caption and label; several environments for a long table."""
    contents = list(_latex_floats(table.blocks))
    environments = (_latex_float(table, blocks, k, k == len(contents) - 1) for k, blocks in enumerate(contents))
    return f"% {' '.join(table.command.split())}\n" + "\n".join(environments)


def _latex_floats(blocks: Sequence[TableBlock]) -> Iterator[list[TableBlock]]:
    """Yield the blocks of each float. A block that continues in the next float repeats its title there."""
    content: list[TableBlock] = []
    room = FLOAT_LINES_MAX
    for block in blocks:
        titled = 1 if block.title else 0
        rows, title = block.rows, block.title
        while True:
            if content and room < titled + min(1, len(rows)):
                yield content
                content, room = [], FLOAT_LINES_MAX
            here = rows[: room - titled]
            content.append(replace(block, title=title, rows=here))
            room -= titled + len(here)
            rows, title = rows[len(here) :], f"{block.title}, continued" if titled else ""
            if not rows:
                break
    yield content


def _latex_float(table: ReportTable, blocks: Sequence[TableBlock], number: int, last: bool) -> str:
    """Return one table environment. Number 0 has the caption, the last one the notes."""
    caption = f"{table.title}. {table.caption}" if number == 0 else f"{table.title}, continued."
    lines = [
        r"\begin{table}[tp]",  # p: a float that is too tall for [t] would delay all later floats
        r"\centering",
        r"\setlength{\belowcaptionskip}{4pt}",  # document classes leave no space below a caption
    ]
    if number:
        lines.append(r"\addtocounter{table}{-1}")
    lines.append(rf"\caption{{{latex_text(caption)}}}")
    if number == 0:
        lines.append(rf"\label{{tab:{table.name.replace('_', '-')}}}")
    lines += [
        r"\footnotesize",
        r"\setlength{\tabcolsep}{4pt}",
        SHRINK_IF_TOO_WIDE,
        rf"\begin{{tabular}}{{@{{}}{''.join(column.align[0] for column in table.columns)}@{{}}}}",
        r"\toprule",
        *_latex_heads(table.columns),
    ]
    for block in blocks:
        lines += [r"\midrule", *_latex_block(block, table.columns)]
    lines += [r"\bottomrule", r"\end{tabular}}"]
    if last and table.notes:
        lines += ["", r"\smallskip", r"{\scriptsize " + " ".join(latex_text(note) for note in table.notes) + r"\par}"]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def latex_text(text: str) -> str:
    """Return the text escaped for LaTeX."""
    return "".join(SPECIAL.get(letter, letter) for letter in " ".join(text.split()))


def _latex_heads(columns: Sequence[TableColumn]) -> Iterator[str]:
    """Yield the line of groups and its rules, if there are groups, and the line of heads."""
    if any(column.group for column in columns):
        cells, rules, first = [], [], 1
        for group, width in groups(columns):
            if group:
                cells.append(rf"\multicolumn{{{width}}}{{c}}{{{latex_text(group)}}}")
                rules.append(rf"\cmidrule(lr){{{first}-{first + width - 1}}}")
            else:
                cells += [""] * width
            first += width
        yield _latex_line(cells)
        yield "".join(rules)
    arrow = {"more": r" $\uparrow$", "less": r" $\downarrow$", None: ""}
    yield _latex_line([latex_text(column.head) + arrow[column.better] for column in columns])


def _latex_block(block: TableBlock, columns: Sequence[TableColumn]) -> Iterator[str]:
    if block.title:
        yield rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{\emph{{{latex_text(block.title)}}}}} \\"
    for row in block.rows:
        yield _latex_line([_latex_cell(cell, column) for cell, column in zip(row.cells, columns, strict=True)])


def _latex_cell(cell: TableCell, column: TableColumn) -> str:
    text = cell.text(column)
    latex = "---" if text == NOTHING else latex_text(text)
    interval = cell.interval(column)
    beside = rf" {{\tiny[{latex_text(interval)}]}}" if interval else ""
    return (rf"\textbf{{{latex}}}" if cell.best else latex) + beside


def _latex_line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"
