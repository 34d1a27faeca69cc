"""The report of a study as files: a page, Markdown, tables, figures, and the flights as data."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.judge.metrics.registry import METRICS
from dronecats.report.report_folder import write_tables
from dronecats.report.results.database import array
from dronecats.report.table import ReportTable
from dronecats.report.writers import as_json as tables_as_json
from dronecats.report.writers import as_markdown, as_shell, escaped
from dronecats.study.analysis.flown_study import flown_study
from dronecats.study.analysis.studied import Studied
from dronecats.study.report import sections, study_page
from dronecats.study.report.figures.drawing import draw
from dronecats.study.report.findings import Findings, findings
from dronecats.study.report.sections import StudySection
from foundation.errors import InfrastructureError
from foundation.whole_file import whole_file, write_text

PAGE, MARKDOWN = "index.html", "report.md"
TABLES, FIGURES, DATA = "tables", "figures", "data"


@dataclass(frozen=True, slots=True)
class StudyReport:
    """A report that was written."""

    page: Path
    markdown: Path
    opening: tuple[str, ...]  # what is to be known before any number
    short: tuple[str, ...]  # what the study says, in a few sentences
    tables: tuple[ReportTable, ...]
    parquet: Path | None  # None: the extra `query` is not installed


def write_study_report(folder: Path, out: Path) -> Path:
    """Write the report of a study's folder into the folder `out`, and return the page's path.

    Raises UsageError for a folder that is no study, or whose runs differ in more than its factors; InfrastructureError
    when the report cannot be written.
    """
    return write(flown_study(folder), f"dronecats study report {folder} --out {out}", out).page


def write(studied: Studied, command: str, out: Path) -> StudyReport:
    """Write the report of a study that was read; `command` is the command line that makes it again."""
    found = findings(studied, command)
    try:
        (out / DATA).mkdir(parents=True, exist_ok=True)
        told = sections.sections(found, draw(found, out / FIGURES))
        every = tuple(table for section in told for table in section.tables)
        write_tables(every, out / TABLES)
        write_csv(studied, out / DATA / CSV)
        parquet = _parquet(studied, out / DATA / PARQUET)
        opening, short = sections.opening(found), sections.short(found)
        title = _title(studied)
        (out / MARKDOWN).write_text(_markdown(title, opening, short, told, found, out), encoding="utf-8")
        write_text(out / PAGE, study_page.page(title, opening, short, told, command))
    except OSError as full:
        raise InfrastructureError(f"the report cannot be written into {out}: {full.strerror or full}") from None
    return StudyReport(out / PAGE, out / MARKDOWN, tuple(opening), tuple(short), every, parquet)


def as_json(made: StudyReport) -> dict[str, Any]:
    """Return the tables as `dronecats study report --json` prints them: by name, rows by the columns' names."""
    return {
        "page": str(made.page),
        "report": str(made.markdown),
        "parquet": made.parquet and str(made.parquet),
        "short": [*made.opening, *made.short],
        "tables": tables_as_json(made.tables),
    }


def _parquet(studied: Studied, path: Path) -> Path | None:
    try:
        write_parquet(studied, path)
    except ImportError:
        return None
    return path


def _title(studied: Studied) -> str:
    return f"Study: {studied.name}"


def _markdown(
    title: str, opening: Sequence[str], short: Sequence[str], told: Sequence[StudySection], found: Findings, out: Path
) -> str:
    parts = [f"# {escaped(title)}\n", *(f"{escaped(said)}\n" for said in opening)]
    parts += ["\n".join(f"- {escaped(said)}" for said in short) + "\n"] if short else []
    parts.append(as_shell([found.command]))
    for section in told:
        parts.append(f"## {escaped(section.title)}\n")
        parts += [f"{escaped(said)}\n" for said in section.said]
        for part in section.parts:
            for figure in part.figures:
                parts.append(f"![{escaped(figure.shows)}]({figure.path.relative_to(out).as_posix()})\n")
                parts.append(f"{escaped(figure.shows)} Made by `{found.command}`.\n")
            parts += [as_markdown(table, level=3) for table in part.tables]
    return "\n".join(parts)


CSV, PARQUET = "flights.csv", "flights.parquet"


@dataclass(frozen=True, slots=True)
class FlightColumn:
    """A column of the data."""

    name: str
    type: str  # of SQL
    values: tuple[Any, ...]  # one a flight


def columns(studied: Studied) -> list[FlightColumn]:
    """Return who flew, episode, flight, levels, outcome and every metric of the whole episode."""
    flights = studied.flights
    found = [
        FlightColumn("entrant", "VARCHAR", tuple(each.entrant for each in flights)),
        FlightColumn("run", "VARCHAR", tuple(each.scored.run.folder.name for each in flights)),
        FlightColumn("episode", "VARCHAR", tuple(each.scored.episode for each in flights)),
        FlightColumn("cell", "VARCHAR", tuple(each.scored.cell for each in flights)),
        FlightColumn("map", "VARCHAR", tuple(each.scored.map for each in flights)),
        FlightColumn("flight_number", "BIGINT", tuple(each.number for each in flights)),
        FlightColumn("seed", "BIGINT", tuple(each.scored.run.seed for each in flights)),
    ]
    for k, factor in enumerate(studied.factors):
        kind = "DOUBLE" if factor.numeric else "VARCHAR"
        found.append(FlightColumn(f"level_{factor.name}", kind, tuple(each.levels[k] for each in flights)))
    found.append(FlightColumn("scored", "BOOLEAN", tuple(each.scored.scored for each in flights)))
    if any(each.scored.left_out for each in flights):
        found.append(FlightColumn("left_out", "VARCHAR", tuple(each.scored.left_out for each in flights)))
    for name, metric in METRICS.items():
        if metric.level == "episode":
            values = tuple(each.scored.values.get(name) for each in flights)
            if any(value is not None for value in values):
                truth = all(value is None or isinstance(value, bool) for value in values)
                told = values if truth else tuple(None if value is None else float(value) for value in values)
                found.append(FlightColumn(name, "BOOLEAN" if truth else "DOUBLE", told))
    return found


def write_csv(studied: Studied, path: Path) -> None:
    """Write the rows as CSV; what is not known is empty. Raises OSError."""
    told = columns(studied)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.name for column in told])
        writer.writerows(zip(*(map(_plain, column.values) for column in told), strict=True))


def write_parquet(studied: Studied, path: Path) -> None:
    """Write the rows as Parquet. Raises ImportError without the extra `query`, OSError where they cannot be."""
    import duckdb

    from dronecats.report.results.database import literal

    told = columns(studied)
    connection = duckdb.connect(":memory:")
    try:
        names = ", ".join(f'"{column.name}" {column.type}' for column in told)
        connection.execute(f"CREATE TABLE flights ({names})")
        arrays = {column.name: array(column.values, column.type) for column in told}
        connection.register("rows", arrays)
        connection.execute("INSERT INTO flights SELECT * FROM rows")
        try:
            with whole_file(path) as draft:
                connection.execute(f"COPY flights TO {literal(str(draft))} (FORMAT parquet, COMPRESSION zstd)")
        except duckdb.IOException as fault:
            raise OSError(None, str(fault)) from None
    finally:
        connection.close()


def _plain(value: Any) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
