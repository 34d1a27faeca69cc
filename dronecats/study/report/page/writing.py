"""Writes the page: what it says in short, then a section a factor, and behind it the tables with all numbers."""

import html
import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.resources import files

from dronecats.report.report_table import ReportTable
from dronecats.study.report.figures.all import StudyFigure
from dronecats.study.report.page.html_table import as_html
from dronecats.study.report.page.inline_svg import inline
from dronecats.study.report.sections import StudySection

LONG = 10  # lines of a table
_FIELD = re.compile("{{(title|style|body)}}")


def page(
    title: str, opening: Sequence[str], short: Sequence[str], sections: Sequence[StudySection], command: str
) -> str:
    """Return the whole page. `opening` are sentences above all, `short` what the study says in as few of them."""
    values = {
        "title": html.escape(title),
        "style": _read("page.css"),
        "body": "\n".join(_body(title, opening, short, sections, command)),
    }
    return _FIELD.sub(lambda match: values[match[1]], _read("page.html"))


def _body(
    title: str, opening: Sequence[str], short: Sequence[str], sections: Sequence[StudySection], command: str
) -> Iterator[str]:
    yield f"<h1>{html.escape(title)}</h1>"
    yield from _paragraphs(opening)
    if short:
        yield '<ul class="short">' + "".join(f"<li>{html.escape(said)}</li>" for said in short) + "</ul>"
    yield f"<pre>{html.escape(command)}</pre>"
    links = (f'<li><a href="#{section.key}">{html.escape(section.title)}</a></li>' for section in sections)
    yield f'<nav aria-label="Sections"><ul>{"".join(links)}</ul></nav>'
    for section in sections:
        yield f'<section id="{section.key}"><h2>{html.escape(section.title)}</h2>'
        yield from _paragraphs(section.said)
        for part in section.parts:
            yield from (_figure(figure, command) for figure in part.figures)
            for table in part.tables:
                yield from _table(table)
        yield "</section>"


def _table(table: ReportTable) -> Iterator[str]:
    """Yield a table with its title; a long one is folded, but on paper."""
    title = html.escape(table.title)
    if len(table.rows) <= LONG:
        yield f"<h3>{title}</h3>{as_html(table)}"
    else:
        yield f"<details><summary>{title}: {len(table.rows)} lines</summary>{as_html(table)}</details>"


def _paragraphs(sentences: Iterable[str]) -> Iterator[str]:
    return (f"<p>{html.escape(said)}</p>" for said in sentences)


def _figure(figure: StudyFigure, command: str) -> str:
    drawing = inline(
        figure.path.with_suffix(".svg").read_text(encoding="utf-8"), figure.name, html.escape(figure.shows)
    )
    stem = html.escape(figure.path.stem)
    return (
        f'<figure><div class="drawing">{drawing}</div><figcaption>{html.escape(figure.shows)}'
        f" <code>{html.escape(command)}</code> writes it as figures/{stem}.svg, .pdf and .png.</figcaption></figure>"
    )


def _read(name: str) -> str:
    return files(__package__ or "").joinpath("web", name).read_text(encoding="utf-8")
