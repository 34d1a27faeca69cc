"""Written tables keep their content: CSV keeps every digit, Markdown and LaTeX keep the columns."""

import csv
import io
import re
import subprocess
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.report import report_data
from dronecats.report import writers as latex
from dronecats.report.report_folder import tables
from dronecats.report.table import (
    ReportTable,
    TableBlock,
    TableCell,
    TableColumn,
    TableRow,
    numbers,
    rounded,
    table_of,
    words,
)
from dronecats.report.tables.comparison import comparison
from dronecats.report.writers import EXTRA_CSV_FIELDS, as_csv, as_html, as_markdown, as_terminal
from tests.needs import needs
from tests.report.small import made, small
from tests.support.scores import a_run, collected, flights, named

MADE = tables(small())
WIDE = r"\setlength{\textwidth}{480pt}\setlength{\oddsidemargin}{-10pt}"  # wide enough that no table is scaled down
PAPERS = {size: rf"\documentclass[{size}paper]{{article}}{WIDE}" for size in ("a4", "letter")}
NAMES = [table.name for table in MADE]
texts = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=12)
LARGEST = 1.7e308


def cells(largest: float) -> st.SearchStrategy[TableCell]:
    """Return a strategy for cells of every kind, with numbers of at most this magnitude."""
    return st.builds(
        TableCell,
        value=st.none() | texts | st.floats(-largest, largest) | st.integers(-9, 99),
        low=st.none() | st.floats(0, 100),
        high=st.none() | st.floats(0, 100),
        count=st.none() | st.integers(0, 9),
        of=st.none() | st.integers(0, 9),
        best=st.booleans(),
    )


@st.composite
def any_table(draw, largest=LARGEST):
    columns = [TableColumn(name=f"c{k}", title=draw(texts), group=draw(st.sampled_from(["", "a", "b"])),
                           unit=draw(st.sampled_from(["", "m", "%"])), align=draw(st.sampled_from(["left", "right"])))
               for k in range(draw(st.integers(1, 4)))]  # fmt: skip
    row = st.builds(TableRow, cells=st.tuples(*[cells(largest)] * len(columns)))
    block = st.builds(TableBlock, title=texts, rows=st.lists(row, max_size=3).map(tuple))
    return ReportTable(name="any", title=draw(texts), caption=draw(texts), columns=tuple(columns),
                       blocks=tuple(draw(st.lists(block, max_size=3))), notes=tuple(draw(st.lists(texts, max_size=2))),
                       command=draw(texts))  # fmt: skip


@settings(max_examples=40)
@given(any_table())
def test_csv_contains_every_field_of_every_cell(table):
    head, *lines = csv.reader(io.StringIO(as_csv(table), newline=""))
    blocks = [block.title for block in table.blocks for _ in block.rows]
    assert [line[0] for line in lines] == blocks
    for line, row in zip(lines, table.rows, strict=True):
        values = dict(zip(head, line, strict=True))
        for column, cell in zip(table.columns, row.cells, strict=True):
            assert values[column.name] == ("" if cell.value is None else str(cell.value))
            for field in EXTRA_CSV_FIELDS:
                value = getattr(cell, field)
                assert values.get(f"{column.name}_{field}", "") == ("" if value is None else str(value))


def test_numbers_in_the_csv_of_the_report_are_read_back_exactly():
    for table in MADE:
        for line, row in zip(csv.DictReader(io.StringIO(as_csv(table))), table.rows, strict=True):
            for column, cell in zip(table.columns, row.cells, strict=True):
                if isinstance(cell.value, int | float):
                    assert float(line[column.name]) == cell.value, table.name


@settings(max_examples=60)
@given(any_table(1e6), st.integers(60, 120))
def test_terminal_output_has_no_line_wider_than_the_terminal_and_loses_no_letter(table, width):
    lines = as_terminal(table, width).splitlines()
    assert [line for line in lines if len(line) > width] == []
    texts = [table.title, table.caption, *(column.title for column in table.columns), *table.notes]
    texts += [cell.text(c) for row in table.rows for cell, c in zip(row.cells, table.columns, strict=True)]
    assert Counter("".join("".join(texts).split())) <= Counter("".join(lines))


def test_columns_that_do_not_fit_continue_below_with_the_row_names_repeated():
    columns = [words("pilot"), *(numbers(f"measure {k}", group="Approaching") for k in range(12))]
    table = table_of(columns, [("oracle", *range(100, 112)), ("blind:ring", *range(200, 212))])
    lines = as_terminal(table, 60).splitlines()
    assert max(map(len, lines)) <= 60
    assert sum(line.startswith("oracle") for line in lines) == sum(line.startswith("blind:ring") for line in lines) > 1
    output_words = " ".join(lines).split()
    assert all(output_words.count(str(number)) == 1 for number in (*range(100, 112), *range(200, 212)))
    assert any(re.fullmatch(r" +─+ Approaching ─+", line) for line in lines)
    assert len(as_terminal(table).splitlines()) == 5


def test_words_are_wrapped_within_their_column_at_blanks_slashes_and_hyphens():
    rows = [("claude-opus", "openrouter/anthropic/claude-opus-5", 1.0), ("a", "first\nsecond", None)]
    table = table_of([words("name"), words("model"), numbers("price")], rows)
    assert as_terminal(table, 41).splitlines() == [
        "name         model                  price",
        "───────────  ─────────────────────  ─────",
        "claude-opus  openrouter/anthropic/      1",
        "             claude-opus-5",
        "a            first                      –",
        "             second",
    ]


def test_html_contains_the_cells_and_escapes_their_text():
    column = TableColumn(name="sr", title="SR <b>", unit="%", better="more")
    cell = TableCell(value=62.5, low=20.0, high=90.0, count=5, of=8, best=True, link="#of/a&b")
    name = TableCell(value="<script>")
    row = TableRow(cells=(name, cell))
    table = ReportTable(title="T", columns=(words("pilot"), column), blocks=(TableBlock(title="<i>", rows=(row,)),))
    text = as_html(table)
    assert '<td class="number best" title="5 of 8"><a href="#of/a&amp;b">63</a> <small>20–90</small></td>' in text
    assert '<th scope="row">&lt;script&gt;</th>' in text
    assert '<th scope="col" class="number">SR &lt;b&gt;\u00a0↑\u00a0<small>%</small></th>' in text
    assert "<i>" not in text


def test_markdown_has_links_and_code():
    column = TableColumn(name="n", title="name", align="left", code=True)
    row = TableRow(cells=(TableCell(value="a_b|c"), TableCell(value="x_y", link="#there")))
    table = ReportTable(columns=(column, words("entry")), blocks=(TableBlock(title="", rows=(row,)),))
    assert as_markdown(table).splitlines()[-1] == r"| `a_b∣c` | [x\_y](#there) |"


@settings(max_examples=40)
@given(any_table())
def test_every_markdown_row_has_all_columns(table):
    lines = [line for line in as_markdown(table).splitlines() if line.startswith("| ")]
    bars = {len(re.findall(r"(?<!\\)\|", re.sub(r"\\\\", "", line))) for line in lines}
    assert bars == {len(table.columns) + 1}


def braces(text: str) -> int:
    """Return the brace depth at the end of a text, read as LaTeX reads it. It is never negative."""
    depth = 0
    for sign in re.findall(r"\\.|[{}]", text):
        depth += {"{": 1, "}": -1}.get(sign, 0)
        assert depth >= 0
    return depth


def stray(text: str) -> list[str]:
    """Return the unescaped characters that LaTeX interprets. Inside $…$, _ and ^ are allowed."""
    characters, formula = [], False
    for sign in re.findall(r"\\(?:[a-zA-Z]+|.)|[&%#_^~$]", text):
        formula ^= sign == "$"
        if sign in "&%#~" or (sign in "_^" and not formula):
            characters.append(sign)
    return [*characters, "$"] if formula else characters


@settings(max_examples=40)
@given(any_table())
def test_latex_closes_every_brace_and_environment_and_fills_every_column(table):
    text = latex.as_latex(table)
    assert braces("\n".join(line for line in text.splitlines() if not line.startswith("%"))) == 0
    opened = re.findall(r"(?m)^\\(begin|end)\{(\w+)\}", text)
    assert opened == [("begin", "table"), ("begin", "tabular"), ("end", "tabular"), ("end", "table")]
    inside = text.split(r"\toprule")[1].split(r"\bottomrule")[0]
    for line in inside.splitlines():
        if line.endswith(r" \\"):
            spans = [int(width) for width in re.findall(r"\\multicolumn\{(\d+)\}", line)]
            assert len(re.findall(r"(?<!\\)&", line)) + 1 + sum(spans) - len(spans) == len(table.columns)
    assert stray(re.sub(r"(?<!\\)&", "", inside)) == []


@given(texts)
def test_latex_escapes_every_special_character(text):
    assert stray(latex.latex_text(text)) == []


def test_latex_prints_bars_and_relations_as_they_are():
    """In LaTeX's default fonts, a bare bar or relation prints another character."""
    assert latex.latex_text("a | b < c > d") == "a $|$ b $<$ c $>$ d"


def test_latex_rules_span_the_columns_of_their_groups():
    main = next(table for table in MADE if table.name == "main")
    text = latex.as_latex(main)
    assert r"\cmidrule(lr){3-4}\cmidrule(lr){5-6}\cmidrule(lr){7-8}" in text
    assert r"\multicolumn{2}{c}{Approaching} & \multicolumn{2}{c}{Tracking} & \multicolumn{2}{c}{All}" in text
    assert r"\multicolumn{9}{@{}l}{\emph{Models}} \\" in text


def test_numbers_are_rounded_half_away_from_zero():
    assert [rounded(value, 0) for value in (12.5, 37.5, -12.5, 0.0, 66.666)] == ["13", "38", "-13", "0", "67"]
    assert rounded(0.125, 2) == "0.13"
    assert [rounded(value, 1) for value in (-1e-17, -0.04, -0.05)] == ["0.0", "0.0", "-0.1"]


def test_a_row_with_a_wrong_number_of_cells_is_an_error():
    column = TableColumn(name="a", title="A")
    row = TableRow(cells=(TableCell(value=1), TableCell(value=2)))
    with pytest.raises(ValueError, match=r"2 .*1 "):
        ReportTable(name="x", title="", caption="", columns=(column,), blocks=(TableBlock(title="", rows=(row,)),))


def nine():
    """Return the data of nine models that flew one episode of each suite: 72 pairs."""
    outcomes = {"campus-approaching": "s", "blocks-commanding": "f"}
    runs = [a_run(f"runs/m{k}", model=named(f"model-{k}")) for k in range(9)]
    return small(collected(*(flights(run, outcomes) for run in runs)))


def test_a_long_table_continues_in_a_second_float_with_its_number_and_loses_no_row():
    table = made(comparison, nine())
    assert len(table.rows) == 72
    first, *more = latex.as_latex(table).split(r"\begin{table}")[1:]
    assert len(more) == 1
    written_rows: list[tuple[str, ...]] = []
    for part in (first, *more):
        body = part.split(r"\toprule")[1].split(r"\bottomrule")[0].split(r"\midrule", 1)[1]
        lines = [line for line in body.splitlines() if line.endswith(r" \\")]
        assert len(lines) <= latex.FLOAT_LINES_MAX
        assert report_data.MODELS in lines[0]
        written_rows += [tuple(line.removesuffix(r" \\").split(" & ")[:3]) for line in lines[1:]]
        assert (r"\label{tab:comparison}" in part) == (part is first)
        assert (r"\addtocounter{table}{-1}" in part) == (part is not first)
    assert written_rows == [tuple(str(cell.value) for cell in row.cells[:3]) for row in table.rows]


def typeset(preamble, body, folder):
    """Return the output of pdflatex for a document. It must succeed."""
    document = rf"{preamble}\usepackage{{booktabs,graphicx}}\begin{{document}}{body}\end{{document}}"
    (folder / "all.tex").write_text(document, encoding="utf-8")
    done = subprocess.run(["pdflatex", "-halt-on-error", "all.tex"], cwd=folder, capture_output=True, text=True,
                          check=False)  # fmt: skip
    assert done.returncode == 0, done.stdout[-2000:]
    return done.stdout


@needs("latex")
def test_the_tables_compile(tmp_path):
    output = typeset(r"\documentclass{article}", "\n".join(latex.as_latex(table) for table in MADE), tmp_path)
    assert "Overfull" not in output, output[-2000:]


@needs("latex")
@pytest.mark.parametrize("preamble", PAPERS.values(), ids=PAPERS)
def test_the_table_of_nine_models_fits_on_its_pages(preamble, tmp_path):
    output = typeset(preamble, latex.as_latex(made(comparison, nine())), tmp_path)
    assert "Overfull" not in output, output[-2000:]
    assert "Float too large" not in output, output[-2000:]
