"""The report of a study as files: a page, Markdown, tables, figures, and the flights as data."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.report.report_table import ReportTable
from dronecats.report.writers.csv_table import as_csv
from dronecats.report.writers.latex import as_latex
from dronecats.report.writers.markdown import as_markdown, as_shell, escaped
from dronecats.study.analysis.flown_study import flown_study
from dronecats.study.analysis.studied import Studied
from dronecats.study.report import flight_rows, sections
from dronecats.study.report.figures.all import draw
from dronecats.study.report.findings import Findings, findings
from dronecats.study.report.page import writing as page
from dronecats.study.report.sections import StudySection
from foundation.errors import InfrastructureError
from foundation.whole_file import write_text

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
        for name in (TABLES, DATA):
            (out / name).mkdir(parents=True, exist_ok=True)
        told = sections.sections(found, draw(found, out / FIGURES))
        every = tuple(table for section in told for table in section.tables)
        for table in every:
            (out / TABLES / f"{table.name}.csv").write_text(as_csv(table), encoding="utf-8")
            (out / TABLES / f"{table.name}.tex").write_text(as_latex(table), encoding="utf-8")
        flight_rows.write_csv(studied, out / DATA / flight_rows.CSV)
        parquet = _parquet(studied, out / DATA / flight_rows.PARQUET)
        opening, short = sections.opening(found), sections.short(found)
        title = _title(studied)
        (out / MARKDOWN).write_text(_markdown(title, opening, short, told, found, out), encoding="utf-8")
        write_text(out / PAGE, page.page(title, opening, short, told, command))
    except OSError as full:
        raise InfrastructureError(f"the report cannot be written into {out}: {full.strerror or full}") from None
    return StudyReport(out / PAGE, out / MARKDOWN, tuple(opening), tuple(short), every, parquet)


def as_json(made: StudyReport) -> dict[str, Any]:
    """Return the tables as `dronecats study report --json` prints them: by name, rows by the columns' names."""
    from dronecats.report.report_folder import as_json as of_tables

    return {
        "page": str(made.page),
        "report": str(made.markdown),
        "parquet": made.parquet and str(made.parquet),
        "short": [*made.opening, *made.short],
        "tables": of_tables(made.tables),
    }


def _parquet(studied: Studied, path: Path) -> Path | None:
    try:
        flight_rows.write_parquet(studied, path)
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
