"""Writes the report of a study: an HTML page, Markdown, tables, figures, and the flights as data files."""

import csv
import html
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.judge.metrics.judging import METRICS
from dronecats.report import figures as style
from dronecats.report.kit import shell
from dronecats.report.report_folder import write_tables
from dronecats.report.results.database import array, literal
from dronecats.report.table import ReportTable
from dronecats.report.writers import as_html, as_markdown, as_shell, escaped
from dronecats.report.writers import as_json as tables_as_json
from dronecats.study.analysis.study_results import StudyResults
from dronecats.study.report.drawing import StudyFigure, draw
from dronecats.study.report.findings import compute_findings
from dronecats.study.report.sections import ReportContent, report_content
from foundation.errors import InfrastructureError
from foundation.files import file_errors_as, whole_file, write_text

PAGE, MARKDOWN = "index.html", "report.md"
TABLES, FIGURES, DATA = "tables", "figures", "data"


@dataclass(frozen=True, slots=True)
class StudyReport:
    page: Path
    markdown: Path
    content: ReportContent
    parquet: Path | None  # None: the extra `query` is not installed


def write(results: StudyResults, command: str, out: Path) -> StudyReport:
    """Write the report of these results. `command` is the report's command line. Raises InfrastructureError."""
    findings = compute_findings(results, command)
    with file_errors_as(InfrastructureError, f"the report cannot be written into {out}"):
        (out / DATA).mkdir(parents=True, exist_ok=True)
        content = report_content(findings, draw(findings, out / FIGURES))
        write_tables(content.tables, out / TABLES)
        columns = flight_columns(results)
        write_csv(columns, out / DATA / CSV)
        parquet = write_parquet(columns, out / DATA / PARQUET)
        (out / MARKDOWN).write_text(_markdown(content, out), encoding="utf-8")
        write_text(out / PAGE, html_page(content))
    return StudyReport(out / PAGE, out / MARKDOWN, content, parquet)


def as_json(report: StudyReport) -> dict[str, Any]:
    """Return the output of `dronecats study report --json`: paths, main sentences, and the tables by name."""
    return {
        "page": str(report.page),
        "report": str(report.markdown),
        "parquet": report.parquet and str(report.parquet),
        "short": [*report.content.opening, *report.content.summary],
        "tables": tables_as_json(report.content.tables),
    }


def _markdown(content: ReportContent, out: Path) -> str:
    lines = [f"# {escaped(content.title)}\n", *(f"{escaped(sentence)}\n" for sentence in content.opening)]
    if content.summary:
        lines.append("\n".join(f"- {escaped(sentence)}" for sentence in content.summary) + "\n")
    lines.append(as_shell([content.command]))
    for section in content.sections:
        lines.append(f"## {escaped(section.title)}\n")
        lines += [f"{escaped(sentence)}\n" for sentence in section.sentences]
        for block in section.blocks:
            for figure in block.figures:
                lines.append(f"![{escaped(figure.caption)}]({figure.path.relative_to(out).as_posix()})\n")
                lines.append(f"{escaped(figure.caption)} Made by `{content.command}`.\n")
            lines += [as_markdown(table, level=3) for table in block.tables]
    return "\n".join(lines)


CSV, PARQUET = "flights.csv", "flights.parquet"


@dataclass(frozen=True, slots=True)
class FlightColumn:
    """A column of the flight data."""

    name: str
    type: str  # SQL type
    values: Sequence[Any]  # one per flight


def flight_columns(results: StudyResults) -> list[FlightColumn]:
    """Return the columns of the flight data: entrant, run, episode, flight, levels, outcome, and episode metrics."""
    flights = results.flights
    episodes = [flight.scored for flight in flights]
    columns = [
        FlightColumn("entrant", "VARCHAR", [flight.entrant for flight in flights]),
        FlightColumn("run", "VARCHAR", [episode.run.folder.name for episode in episodes]),
        FlightColumn("episode", "VARCHAR", [episode.episode for episode in episodes]),
        FlightColumn("cell", "VARCHAR", [episode.cell for episode in episodes]),
        FlightColumn("map", "VARCHAR", [episode.map for episode in episodes]),
        FlightColumn("flight_number", "BIGINT", [flight.number for flight in flights]),
        FlightColumn("seed", "BIGINT", [episode.run.seed for episode in episodes]),
    ]
    for k, factor in enumerate(results.factors):
        sql_type = "DOUBLE" if factor.numeric else "VARCHAR"
        columns.append(FlightColumn(f"level_{factor.name}", sql_type, [flight.levels[k] for flight in flights]))
    columns.append(FlightColumn("scored", "BOOLEAN", [episode.scored for episode in episodes]))
    if any(episode.left_out for episode in episodes):
        columns.append(FlightColumn("left_out", "VARCHAR", [episode.left_out for episode in episodes]))
    for name in (name for name, metric in METRICS.items() if metric.level == "episode"):
        values = [episode.values.get(name) for episode in episodes]
        if all(value is None or isinstance(value, bool) for value in values):
            columns += [FlightColumn(name, "BOOLEAN", values)] if any(value is not None for value in values) else []
        else:
            columns.append(FlightColumn(name, "DOUBLE", [None if value is None else float(value) for value in values]))
    return columns


def write_csv(columns: Sequence[FlightColumn], path: Path) -> None:
    """Write the flights as CSV. Unknown values are empty. Raises OSError."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        writer.writerows(zip(*(map(_csv_value, column.values) for column in columns), strict=True))


def write_parquet(columns: Sequence[FlightColumn], path: Path) -> Path | None:
    """Write the flights as Parquet and return the path; None without the extra `query`. Raises OSError."""
    try:
        import duckdb
    except ImportError:
        return None
    connection = duckdb.connect(":memory:")
    try:
        names = ", ".join(f'"{column.name}" {column.type}' for column in columns)
        connection.execute(f"CREATE TABLE flights ({names})")
        arrays = {column.name: array(column.values, column.type) for column in columns}
        connection.register("rows", arrays)
        connection.execute("INSERT INTO flights SELECT * FROM rows")
        try:
            with whole_file(path) as draft:
                connection.execute(f"COPY flights TO {literal(str(draft))} (FORMAT parquet, COMPRESSION zstd)")
        except duckdb.IOException as fault:
            raise OSError(None, str(fault)) from None
    finally:
        connection.close()
    return path


def _csv_value(value: Any) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


LONG = 10  # a table with more rows is folded
# colour in a figure → name of the page's CSS variable
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


def html_page(content: ReportContent) -> str:
    """Return the HTML page. It begins with the opening sentences and the summary."""
    page = shell.PageContent(
        title=content.title,
        folder=__package__ or "",
        trail=f"<li>{html.escape(content.title)}</li>",
        main="\n".join(_body(content)),
        has_drawings=True,
    )
    return "".join(shell.page(page))


def _body(content: ReportContent) -> Iterator[str]:
    yield f"<h1>{html.escape(content.title)}</h1>"
    yield from _paragraphs(content.opening)
    if content.summary:
        items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in content.summary)
        yield f'<ul class="short">{items}</ul>'
    yield f"<pre>{html.escape(content.command)}</pre>"
    links = (f'<li><a href="#{section.key}">{html.escape(section.title)}</a></li>' for section in content.sections)
    yield f'<nav aria-label="Sections"><ul>{"".join(links)}</ul></nav>'
    for section in content.sections:
        yield f'<section id="{section.key}"><h2>{html.escape(section.title)}</h2>'
        yield from _paragraphs(section.sentences)
        for block in section.blocks:
            yield from (_figure(figure, content.command) for figure in block.figures)
            for table in block.tables:
                yield from _table(table)
        yield "</section>"


def _table(table: ReportTable) -> Iterator[str]:
    """Yield a table with its title. A long table is folded, except in print."""
    title = html.escape(table.title)
    if len(table.rows) <= LONG:
        yield f"<h3>{title}</h3>{as_html(table)}"
    else:
        yield f"<details><summary>{title}: {len(table.rows)} rows</summary>{as_html(table)}</details>"


def _paragraphs(sentences: Iterable[str]) -> Iterator[str]:
    return (f"<p>{html.escape(sentence)}</p>" for sentence in sentences)


def _figure(figure: StudyFigure, command: str) -> str:
    drawing = inline(
        figure.path.with_suffix(".svg").read_text(encoding="utf-8"), figure.name, html.escape(figure.caption)
    )
    stem = html.escape(figure.path.stem)
    return (
        f'<figure><div class="drawing">{drawing}</div><figcaption>{html.escape(figure.caption)}'
        f" <code>{html.escape(command)}</code> writes it as figures/{stem}.svg, .pdf and .png.</figcaption></figure>"
    )


def inline(svg: str, key: str, label: str) -> str:
    """Return an SVG figure as an HTML element; `key` is the prefix of its ids, `label` is for screen readers.

    The colours of COLOURS become CSS variables of the page, so the figure fits the light and the dark theme.
    """
    body = STYLE.sub("", METADATA.sub("", HEAD.sub("", svg)))
    body = BACKGROUND.sub("", body, count=1)
    box = VIEW.search(body)
    size = box[1] if box else "0 0 100 100"
    body = OPENING.sub("", body, count=1)
    body = ID.sub(lambda match: f'id="{key}-{match[1]}"', body)
    body = body.replace('="#', f'="#{key}-').replace("url(#", f"url(#{key}-")
    for colour, name in COLOURS.items():
        body = re.sub(rf"{colour}(?![0-9a-fA-F])", f"var(--{name})", body, flags=re.IGNORECASE)
    return f'<svg role="img" aria-label="{label}" viewBox="{size}" xmlns:xlink="http://www.w3.org/1999/xlink">{body}'
