"""What an audit says of a suite: how many episodes a pilot solved, how soon, at what price, in how many steps."""

import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from dronecats.report.table import CellValue, ReportTable, numbers, table_of, words
from episodes.records import suites
from episodes.records.baselines import BlindFlight, BlindTable
from episodes.records.record import CELLS
from foundation.run_folder.results import SCORED, Result
from foundation.wording import counted


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """One line of the report. A share that nothing was measured for is None."""

    name: str  # a suite, or a map and cell
    solved: int  # of `flown`: SR, the paper's criterion
    flown: int  # scored flights; errors of the infrastructure are nobody's
    errors: int
    at_first: int | None  # solved by the first declaration: SR₁
    within_three: int | None  # … by one of the first three: SR₃
    precision: float | None  # 0 … 1, true declarations of all, mean over the flights that declared
    false_declarations: float | None  # per flight, the mean
    censored: int  # flights that ended with their first success, whose later declarations nobody knows
    steps: float | None  # median over the solved

    def as_json(self) -> dict[str, Any]:
        """Return the row as `episodes audit --json` prints it."""
        return {
            "name": self.name,
            "solved": self.solved,
            "flown": self.flown,
            "errors": self.errors,
            "solved_at_first": self.at_first,
            "solved_within_three": self.within_three,
            "precision": self.precision,
            "false_declarations": self.false_declarations,
            "censored": self.censored,
            "median_steps": self.steps,
        }


def row(name: str, results: Iterable[Result]) -> ScoreRow:
    """Return the line of these results."""
    results = list(results)
    scored = [r for r in results if r.outcome in SCORED]
    solved = [r for r in scored if r.outcome == "success"]
    precise = [r.declaration_precision for r in scored if r.declaration_precision is not None]
    false = [r.false_declarations for r in scored if r.false_declarations is not None]
    return ScoreRow(
        name=name,
        solved=len(solved),
        flown=len(scored),
        errors=len(results) - len(scored),
        at_first=_count(r.success_at_first for r in scored),
        within_three=_count(r.success_within_three for r in scored),
        precision=round(statistics.fmean(precise), 4) if precise else None,
        false_declarations=round(statistics.fmean(false), 4) if false else None,
        censored=sum(bool(r.censored) for r in scored),
        steps=statistics.median(r.steps for r in solved) if solved else None,
    )


def _count(measured: Iterable[bool | None]) -> int | None:
    """Return of how many flights a measure holds; None when it was not taken of all of them."""
    each = list(measured)
    return None if None in each else sum(map(bool, each))


def table(results: Iterable[Result]) -> list[ScoreRow]:
    """Return a line per map and cell, one per suite that is among the results, and one for everything."""
    return [row(name, members) for name, members in groups(results).items()]


def groups(results: Iterable[Result]) -> dict[str, list[Result]]:
    """Return the results of each line of the table, in the table's order."""
    results = sorted(results, key=lambda r: r.episode)
    cells: dict[str, list[Result]] = {}
    for result in results:
        cells.setdefault(cell_of(result.episode), []).append(result)
    found = {name: cells[name] for name in sorted(cells, key=cell_order)}
    for suite in ("quick", "one-drone", "commanding", "v1"):
        known = set(suites.ids(suite))
        members = [r for r in results if r.episode in known]
        if members:
            found[suite] = members
    return {**found, "all": results}


def pars(results: Iterable[Result]) -> dict[str, int]:
    """Return the steps of every solved episode by id."""
    return {r.episode: r.steps for r in results if r.outcome == "success"}


def flights(results: Iterable[Result]) -> dict[str, BlindFlight]:
    """Return the scored flights of a blind pilot by id, as they are kept."""
    return {
        r.episode: BlindFlight(
            success=r.outcome == "success",
            first=bool(r.success_at_first),
            within_three=bool(r.success_within_three),
            declarations=int(r.declarations or 0),
            false_declarations=int(r.false_declarations or 0),
            steps=r.steps,
        )
        for r in results
        if r.outcome in SCORED and r.success_at_first is not None
    }


@dataclass(frozen=True, slots=True)
class Floor:
    """The best that was reached on a line's episodes without looking."""

    solved: tuple[str, ScoreRow]  # (pilot, its row), the one that solved most …
    within_three: tuple[str, ScoreRow]  # … and the one that solved most with three declarations


def floor(blind: BlindTable, name: str, results: Iterable[Result]) -> Floor | None:
    """Return the floor under these results; None when no blind pilot has flown all of their episodes."""
    episodes = [r.episode for r in results]
    rows = [
        (pilot, row(name, [_as_result(episode, flown[episode]) for episode in episodes]))
        for pilot, flown in sorted(blind.items())
        if all(episode in flown for episode in episodes)
    ]
    if not rows or not episodes:
        return None
    return Floor(
        max(rows, key=lambda r: (r[1].solved, r[1].within_three or 0)),
        max(rows, key=lambda r: (r[1].within_three or 0, r[1].solved)),
    )


def _as_result(episode: str, flight: BlindFlight) -> Result:
    told = flight.declarations
    return Result(
        episode=episode,
        outcome="success" if flight.success else "failure",
        steps=flight.steps,
        declarations=told,
        success_at_first=flight.first,
        success_within_three=flight.within_three,
        declaration_precision=(told - flight.false_declarations) / told if told else None,
        false_declarations=flight.false_declarations,
    )


def cell_of(episode: str) -> str:
    """Return an id without its number: `residential-tracking-03` is one of `residential-tracking`."""
    stem, _, number = episode.rpartition("-")
    return stem if number.isdigit() else episode


def cell_order(group: str) -> tuple[int, str]:
    """Return by what maps and cells are sorted: the paper's order of the cells, and others behind them."""
    cells = [k for k, cell in enumerate(CELLS) if group.endswith(f"-{cell}")]
    # 'search-and-track' is no 'tracking', and a file of the user's is neither
    return (cells[-1] if cells else len(CELLS), group)


def as_table(rows: Iterable[ScoreRow], under: Mapping[str, Floor | None]) -> ReportTable:
    """Return the rows as a table, under each of them the best blind pilots on the same episodes."""
    lines = []
    for each in rows:
        lines.append(_line(each.name, each))
        below = under.get(each.name)
        best = dict.fromkeys((below.solved, below.within_three)) if below else ()
        lines += [_line(f"  {pilot}", row_of_pilot) for pilot, row_of_pilot in best]
    has_notes = any(line[-1] for line in lines)
    columns = [
        words("episodes"), *map(numbers, ("solved", "at first", "in three")), numbers("precision", decimals=2),
        numbers("false", decimals=1), numbers("steps"), *([words("")] if has_notes else []),
    ]  # fmt: skip
    notes = ["solved, at first, in three: of the flights; false: declarations a flight; steps: median of the solved"]
    if not any(under.values()):
        notes.append("no blind pilot has flown all of these episodes: --pilot blind:ring does")
    return table_of(columns, (line if has_notes else line[:-1] for line in lines), *notes)


def _line(name: str, each: ScoreRow) -> tuple[CellValue, ...]:
    measures = (each.solved, each.at_first, each.within_three)
    counts = (None if count is None else f"{count}/{each.flown}" for count in measures)
    steps = None if each.steps is None else f"{each.steps:g}"
    notes = [f"{counted(each.errors, 'error')}, not scored"] if each.errors else []
    notes += [f"{each.censored} censored"] if each.censored else []
    return name, *counts, each.precision, each.false_declarations, steps, "; ".join(notes)
