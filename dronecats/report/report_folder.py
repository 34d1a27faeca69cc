"""Writes the report of a benchmark: report.md, tables/ and figures/."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from dronecats.judge.metrics.metric import Metric
from dronecats.report.report_data import ReportData, entrants
from dronecats.report.results.collection import Collection, Exclusion, exclusion_sentences, unflown
from dronecats.report.table import ReportTable
from dronecats.report.tables import comparison, measures, outcomes, setup
from dronecats.report.writers import as_csv, as_latex, as_markdown, as_shell, escaped
from episodes.records.catalogue import load_blind
from foundation.errors import InfrastructureError
from foundation.files import file_errors_as
from foundation.protocol import RADIUS_M
from foundation.wording import counted

TABLES = (*outcomes.TABLES, *comparison.TABLES, *measures.TABLES, *setup.TABLES)
TABLE_NAMES = tuple(table.__name__ for table in (*TABLES, measures.own))  # the function has the name of its table


def tables(data: ReportData, metrics: Sequence[Metric] = ()) -> tuple[ReportTable, ...]:
    """Return the tables that have rows. `metrics`: the user's own metrics."""
    results = [*(table(data) for table in TABLES), measures.own(data, metrics)]
    return tuple(table for table in results if table is not None)


def report_data(
    collection: Collection, command: str, *, delta_m: float = RADIUS_M, pool_anyway: bool = False
) -> ReportData:
    """Return the data of the report. Raises UsageError for runs that must not be counted together.

    `delta_m`: the success radius of `collection`. Results of blind pilots exist only for the benchmark's radius.
    """
    blind = load_blind() if delta_m == RADIUS_M else {}
    return ReportData(entrants=entrants(collection, pool_anyway=pool_anyway), blind=blind, command=command)


def opening(data: ReportData, delta_m: float, exclusions: Sequence[Exclusion] = ()) -> list[str]:
    """Return the sentences above all tables."""
    flights = data.episodes
    episodes, scored = len({flight.episode for flight in flights}), sum(flight.scored for flight in flights)
    sentences = [f"{counted(len(flights), 'flight')} of {counted(episodes, 'episode')}, {scored} of them scored."]
    sentences += exclusion_sentences(flights, exclusions)
    for benchmark in unflown(run for entrant in data.entrants for run in entrant.runs):
        sentences.append(
            f"Of the benchmark in {benchmark.folder}, {benchmark.missing} of {benchmark.flights} flights are not in"
            " this report."
        )
    if delta_m != RADIUS_M:
        sentences.append(f"The success radius is {delta_m:g} m instead of the benchmark's {RADIUS_M:g} m.")
    if not any(entrant.is_model for entrant in data.entrants):
        sentences.append("No model flew: all rows are built-in pilots.")
    return [*sentences, *data.warnings()]


def write(tables: Sequence[ReportTable], figures: Mapping[str, Path], head: Sequence[str], out: Path) -> Path:
    """Write the tables, and report.md with tables and figures, into the folder; return the path of report.md.

    `figures` maps table names to files; figures without a table are placed last. `head`: sentences above all tables.
    Tables of an earlier report in `out` that this report does not have are removed. Raises InfrastructureError when the
    report cannot be written.
    """
    page = out / "report.md"
    with file_errors_as(InfrastructureError, f"the report cannot be written into {out}"):
        for name in set(TABLE_NAMES).difference(table.name for table in tables):
            for suffix in (".csv", ".tex"):
                (out / "tables" / f"{name}{suffix}").unlink(missing_ok=True)
        write_tables(tables, out / "tables")
        page.write_text(
            _page(tables, {name: path.relative_to(out) for name, path in figures.items()}, head), encoding="utf-8"
        )
    return page


def write_tables(tables: Iterable[ReportTable], folder: Path) -> None:
    """Write each table as CSV and LaTeX into the folder. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        (folder / f"{table.name}.csv").write_text(as_csv(table), encoding="utf-8")
        (folder / f"{table.name}.tex").write_text(as_latex(table), encoding="utf-8")


def _page(tables: Sequence[ReportTable], figures: Mapping[str, Path], head: Sequence[str]) -> str:
    sections = ["# Report\n", *(f"{escaped(sentence)}\n" for sentence in head)]
    sections.append(as_shell(dict.fromkeys(table.command for table in tables)))
    for table in tables:
        sections.append(as_markdown(table))
        sections += [_picture(figures[table.name], table.title)] if table.name in figures else []
    for name in (name for name in figures if name not in {table.name for table in tables}):
        title = name.replace("_", " ").capitalize()
        sections += [f"## {title}\n", _picture(figures[name], title)]
    return "\n".join(sections)


def _picture(path: Path, title: str) -> str:
    return f"![{escaped(title)}]({path.as_posix()})\n"
