"""A table as LaTeX with booktabs: `\\input` it after `\\usepackage{booktabs,graphicx}`; a wide one is made to fit.

A long one goes on in further floats under the same number: `longtable` would break it over pages too, but neither in
two columns nor made to fit in width.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from dronecats.report.table import NOTHING, ReportTable, TableBlock, TableCell, TableColumn, groups

SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "–": "--", "−": "$-$", "α": r"$\alpha$", "δ": r"$\delta$",
    "°": r"$^\circ$", "≤": r"$\le$", "≥": r"$\ge$", "·": r"$\cdot$", "₁": "$_1$", "₃": "$_3$", "×": r"$\times$",
    "<": "$<$",
}  # fmt: skip

LINES_MAX = 40  # of a float, titles of blocks included: with a caption of ten lines they fit onto A4 and letter
WHERE_TOO_WIDE = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"  # and no other is made smaller


def as_latex(table: ReportTable) -> str:
    """Return the table environment, with caption and label; of a long table as many of them as it takes."""
    parts = list(_parts(table.blocks))
    floats = (_float(table, blocks, k, k == len(parts) - 1) for k, blocks in enumerate(parts))
    return f"% {' '.join(table.command.split())}\n" + "\n".join(floats)


def _parts(blocks: Sequence[TableBlock]) -> Iterator[list[TableBlock]]:
    """Yield what stands in each float, at least one; a block that is broken has its title again."""
    part: list[TableBlock] = []
    room = LINES_MAX
    for block in blocks:
        titled = 1 if block.title else 0
        rows, title = block.rows, block.title
        while True:
            if part and room < titled + min(1, len(rows)):
                yield part
                part, room = [], LINES_MAX
            here = rows[: room - titled]
            part.append(replace(block, title=title, rows=here))
            room -= titled + len(here)
            rows, title = rows[len(here) :], f"{block.title}, continued" if titled else ""
            if not rows:
                break
    yield part


def _float(table: ReportTable, blocks: Sequence[TableBlock], number: int, last: bool) -> str:
    """Return one table environment; that of `number` 0 has the caption, the last one the notes."""
    caption = f"{table.title}. {table.caption}" if number == 0 else f"{table.title}, continued."
    lines = [
        r"\begin{table}[tp]",  # a page of its own too: what is too tall for a top holds up all that follow
        r"\centering",
        r"\setlength{\belowcaptionskip}{4pt}",  # it stands above, and classes leave no space there
    ]
    if number:
        lines.append(r"\addtocounter{table}{-1}")
    lines.append(rf"\caption{{{escaped(caption)}}}")
    if number == 0:
        lines.append(rf"\label{{tab:{table.name.replace('_', '-')}}}")
    lines += [
        r"\footnotesize",
        r"\setlength{\tabcolsep}{4pt}",
        WHERE_TOO_WIDE,
        rf"\begin{{tabular}}{{@{{}}{''.join(column.align[0] for column in table.columns)}@{{}}}}",
        r"\toprule",
        *_heads(table.columns),
    ]
    for block in blocks:
        lines += [r"\midrule", *_block(block, table.columns)]
    lines += [r"\bottomrule", r"\end{tabular}}"]
    if last and table.notes:
        lines += ["", r"\smallskip", r"{\scriptsize " + " ".join(escaped(note) for note in table.notes) + r"\par}"]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def escaped(text: str) -> str:
    """Return the text so that LaTeX sets it as it is."""
    return "".join(SPECIAL.get(letter, letter) for letter in " ".join(text.split()))


def _heads(columns: Sequence[TableColumn]) -> Iterator[str]:
    """Yield the line of groups with their rules, where there are any, and the line of heads."""
    if any(column.group for column in columns):
        cells, rules, first = [], [], 1
        for group, width in groups(columns):
            if group:
                cells.append(rf"\multicolumn{{{width}}}{{c}}{{{escaped(group)}}}")
                rules.append(rf"\cmidrule(lr){{{first}-{first + width - 1}}}")
            else:
                cells += [""] * width
            first += width
        yield _line(cells)
        yield "".join(rules)
    yield _line([_head(column) for column in columns])


def _head(column: TableColumn) -> str:
    arrow = {"more": r" $\uparrow$", "less": r" $\downarrow$", None: ""}[column.better]
    return escaped(column.head) + arrow


def _block(block: TableBlock, columns: Sequence[TableColumn]) -> Iterator[str]:
    if block.title:
        yield rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{\emph{{{escaped(block.title)}}}}} \\"
    for row in block.rows:
        yield _line([_cell(cell, column) for cell, column in zip(row.cells, columns, strict=True)])


def _cell(cell: TableCell, column: TableColumn) -> str:
    text = cell.text(column)
    told = "---" if text == NOTHING else escaped(text)
    interval = cell.interval(column)
    beside = rf" {{\tiny[{escaped(interval)}]}}" if interval else ""
    return (rf"\textbf{{{told}}}" if cell.best else told) + beside


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"
