"""A table as HTML: heads with their groups, blocks as lines of their own, intervals small beside their values."""

import html
import itertools
from collections.abc import Iterator, Sequence

from dronecats.report.report_table import ReportTable, TableCell, TableColumn

SHORT = 45  # letters of words that are not broken


def as_html(table: ReportTable) -> str:
    """Return the table in a box that scrolls by itself where it is wider than the page."""
    lines = [
        f'<div class="box"><p class="caption">{html.escape(table.caption)}</p>',
        f'<div class="wide" tabindex="0" role="region" aria-label="{html.escape(table.title)}"><table>',
        "<thead>",
        *_heads(table.columns),
        "</thead>",
    ]
    for block in table.blocks:
        lines.append("<tbody>")
        if block.title:
            head = f'<th class="block" scope="rowgroup" colspan="{len(table.columns)}">'
            lines.append(f"<tr>{head}<span>{html.escape(block.title)}</span></th></tr>")
        for row in block.rows:
            cells = [_cell(c, column, k) for k, (c, column) in enumerate(zip(row.cells, table.columns, strict=True))]
            lines.append(f"<tr>{''.join(cells)}</tr>")
        lines.append("</tbody>")
    lines.append("</table></div></div>")
    lines += [f'<p class="quiet">{html.escape(note)}</p>' for note in table.notes]
    return "\n".join(lines)


def _heads(columns: Sequence[TableColumn]) -> Iterator[str]:
    if any(column.group for column in columns):
        cells = ["<td></td>"] if not columns[0].group else []  # the first column stays when the others are scrolled
        for group, members in itertools.groupby(columns[len(cells) :], lambda column: column.group):
            width = len(list(members))
            cells.append(f'<th class="group" scope="colgroup" colspan="{width}">{html.escape(group)}</th>'
                         if group else f'<td colspan="{width}"></td>')  # fmt: skip
        yield f"<tr>{''.join(cells)}</tr>"
    cells = []
    for column in columns:
        unit = f" ({column.head_unit})" if column.head_unit not in ("", "%", "$") else ""
        side = ' class="number"' if column.align == "right" else ""
        cells.append(f'<th scope="col"{side}>{html.escape(column.title + unit)}</th>')
    yield f"<tr>{''.join(cells)}</tr>"


def _cell(cell: TableCell, column: TableColumn, k: int) -> str:
    told = html.escape(cell.text(column))
    if interval := cell.interval(column):
        told += f" <small>{html.escape(interval)}</small>"
    if k == 0:
        return f'<th scope="row">{told}</th>'
    if column.align == "right":
        return f'<td class="number">{told}</td>'
    return f'<td class="short-words">{told}</td>' if len(told) <= SHORT else f"<td>{told}</td>"
