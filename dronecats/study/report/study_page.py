"""The page of a study: its summary, then a section per factor, each with figures and the tables behind them."""

import html
import re
from collections.abc import Iterable, Iterator, Sequence

from dronecats.report.figures import style
from dronecats.report.kit import shell
from dronecats.report.table import ReportTable
from dronecats.report.writers import as_html
from dronecats.study.report.figures.drawing import StudyFigure
from dronecats.study.report.sections import StudySection

LONG = 10  # rows of a table that is not folded
# as the drawing has them → the page's variables
COLOURS = {
    style.INK: "ink", style.GREY: "mute", style.LIGHT: "line", "#000000": "ink", style.BLUE: "blue",
    style.VERMILION: "vermilion", style.GREEN: "green", style.PURPLE: "purple", style.ORANGE: "orange",
    style.SKY: "sky", "#FFFFFF": "panel",
}  # fmt: skip
HEAD = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
STYLE = re.compile(r"<style\b.*?</style>", re.DOTALL)
OPENING = re.compile(r"<svg\b[^>]*>")
VIEW = re.compile(r'viewBox="([^"]*)"')
ID = re.compile(r'\bid="([^"]+)"')
BACKGROUND = re.compile(r'<g id="patch_1">.*?</g>', re.DOTALL)
IN_FIELD = re.compile(r"<!-- \d+ -->")


def page(
    title: str, opening: Sequence[str], short: Sequence[str], sections: Sequence[StudySection], command: str
) -> str:
    """Return the page. `opening` are sentences at the top, `short` the summary in a few sentences."""
    content = shell.PageContent(
        title=title,
        folder=__package__ or "",
        trail=f"<li>{html.escape(title)}</li>",
        main="\n".join(_body(title, opening, short, sections, command)),
        has_drawings=True,
    )
    return "".join(shell.page(content))


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


def inline(svg: str, key: str, label: str) -> str:
    """Return a figure's SVG as an element of the page; `key` is put before its ids, `label` says what it shows.

    Its colours are the page's own, so that one drawing is right on dark and on light. Text without a colour is black in
    SVG and takes the page's ink. Numbers in coloured fields keep their white and black, as these fields keep theirs.
    """
    body = STYLE.sub("", METADATA.sub("", HEAD.sub("", svg)))
    body = BACKGROUND.sub("", body, count=1)
    box = VIEW.search(body)
    size = box[1] if box else "0 0 100 100"
    body = OPENING.sub("", body, count=1)
    body = ID.sub(lambda found: f'id="{key}-{found[1]}"', body)
    body = body.replace('="#', f'="#{key}-').replace("url(#", f"url(#{key}-")
    for colour, name in COLOURS.items():
        body = re.sub(rf"{colour}(?![0-9a-fA-F])", f"var(--{name})", body, flags=re.IGNORECASE)
    return f'<svg role="img" aria-label="{label}" viewBox="{size}" xmlns:xlink="http://www.w3.org/1999/xlink">{body}'
