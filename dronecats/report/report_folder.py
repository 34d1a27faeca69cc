"""The report of a benchmark as files: report.md, tables/ and figures/."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from dronecats.report.latex import as_latex
from dronecats.report.report_data import ReportData
from dronecats.report.results.collection import Collection
from dronecats.report.results.entrants import entrants
from dronecats.report.results.exclusion import Exclusion, exclusion_sentences, unflown
from dronecats.report.table import ReportTable
from dronecats.report.writers import as_csv, as_markdown, as_shell, escaped
from episodes.records.catalogue import load_blind
from foundation.errors import InfrastructureError
from foundation.protocol import RADIUS_M


def report_data(collection: Collection, command: str, *, pool_anyway: bool = False) -> ReportData:
    """Return what the report is about. Raises UsageError for runs that must not be counted together."""
    return ReportData(entrants=entrants(collection, pool_anyway=pool_anyway), blind=load_blind(), command=command)


def opening(who: ReportData, delta_m: float, exclusions: Sequence[Exclusion] = ()) -> list[str]:
    """Return what is to be known before any table, sentences."""
    flown = who.episodes
    scored = sum(each.scored for each in flown)
    said = [f"{len(flown)} flights of {len({each.episode for each in flown})} episodes, {scored} of them scored."]
    said += exclusion_sentences(flown, exclusions)
    for each in unflown(run for entrant in who.entrants for run in entrant.runs):
        said.append(f"Of the benchmark in {each.folder}, {each.missing} of {each.flights} flights are not in here.")
    if delta_m != RADIUS_M:
        said.append(f"The success radius is {delta_m:g} m, and not the benchmark's {RADIUS_M:g} m.")
    if not any(entrant.is_model for entrant in who.entrants):
        said.append("No model flew: all lines are of built-in pilots.")
    return [*said, *who.warnings()]


def write(made: Sequence[ReportTable], figures: Mapping[str, Path], head: Sequence[str], out: Path) -> Path:
    """Write the tables, and report.md that holds them with the figures, into the folder; return report.md's path.

    `figures` are by the table that they are of; what is of none stands at the end. `head` are sentences above all
    tables. Raises InfrastructureError when it cannot be written.
    """
    try:
        write_tables(made, out / "tables")
        page = out / "report.md"
        page.write_text(
            _page(made, {of: path.relative_to(out) for of, path in figures.items()}, head), encoding="utf-8"
        )
    except OSError as full:
        raise InfrastructureError(f"the report cannot be written into {out}: {full.strerror}") from None
    return page


def write_tables(made: Iterable[ReportTable], folder: Path) -> None:
    """Write each table as CSV and LaTeX into the folder. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    for table in made:
        (folder / f"{table.name}.csv").write_text(as_csv(table), encoding="utf-8")
        (folder / f"{table.name}.tex").write_text(as_latex(table), encoding="utf-8")


def _page(made: Sequence[ReportTable], figures: Mapping[str, Path], head: Sequence[str]) -> str:
    parts = ["# Report\n", *(f"{escaped(said)}\n" for said in head)]
    parts.append(as_shell(dict.fromkeys(table.command for table in made)))
    for table in made:
        parts.append(as_markdown(table))
        parts += [_picture(figures[table.name], table.title)] if table.name in figures else []
    beneath = {table.name for table in made}
    for name in (each for each in figures if each not in beneath):
        title = name.replace("_", " ").capitalize()
        parts += [f"## {title}\n", _picture(figures[name], title)]
    return "\n".join(parts)


def _picture(path: Path, title: str) -> str:
    return f"![{escaped(title)}]({path.as_posix()})\n"
