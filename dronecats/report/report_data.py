"""Who stands in the tables, in which blocks, and what is said of them there."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from dronecats.pilots import roster
from dronecats.pilots.oracle.failing import FAILURES
from dronecats.pilots.scripted import PATTERNS
from dronecats.report.results.collection import ScoredEpisode
from dronecats.report.results.entrants import Entrant
from dronecats.report.results.identity import differences, identity, refusal
from dronecats.report.table import TableBlock, TableCell, TableColumn, TableRow, row
from episodes.records.catalogue import BlindTable
from episodes.records.record import CELLS

MODELS = "Models"
BUILT_IN = "Built-in pilots, no models"
FLOOR = "The best without looking"
COMMANDING = "commanding"  # the cell that a fleet flies
ONE_DRONE = tuple(cell for cell in CELLS if cell != COMMANDING)
OURS = {
    roster.ORACLE: "is told the truth, to see that episodes can be solved",
    roster.NOISY: "is told the truth and errs as classical vision does, for studies of thousands of flights",
    "vision": "is classical computer vision",
    "blind": "sees nothing",
}

RowOf = Callable[[Entrant], "Sequence[TableCell] | None"]  # the cells behind the name; None: it has no line there


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportData:
    """All that the tables are made of."""

    entrants: tuple[Entrant, ...]
    blind: BlindTable  # what pilots that do not look came to on the episodes that ship
    command: str  # the command line that makes the report

    @property
    def episodes(self) -> tuple[ScoredEpisode, ...]:
        """Every flight of everybody."""
        return tuple(each for entrant in self.entrants for each in entrant.episodes)

    def cells(self, among: Iterable[str] = ONE_DRONE) -> list[str]:
        """Return which of these cells were flown, in the grid's order."""
        flown = {each.cell for each in self.episodes}
        return [cell for cell in among if cell in flown]

    def maps(self) -> list[str]:
        """Return the maps that were flown, by name."""
        return sorted({each.map for each in self.episodes} - {""})

    def blocks(self, columns: Sequence[TableColumn], row_of: RowOf) -> tuple[TableBlock, ...]:
        """Return a block of models and one of built-in pilots, each without who has no line.

        The best of the models is marked; built-in pilots are there for what they show, and none is to be best."""
        found = []
        for title, is_model in ((MODELS, True), (BUILT_IN, False)):
            told = [(e.label, row_of(e)) for e in self.entrants if e.is_model is is_model]
            rows = [row(name, *cells, entrant=name) for name, cells in told if cells is not None]
            if rows:
                found.append(TableBlock(title=title, rows=_marked(rows, columns) if is_model else tuple(rows)))
        return tuple(found)

    def notes(self) -> tuple[str, ...]:
        """Return what each built-in pilot is, a sentence each."""
        said = [what_it_is(e.setting.pilot) for e in self.entrants if not e.is_model and not e.setting.replayed]
        return tuple(dict.fromkeys(each for each in said if each))

    def warnings(self) -> tuple[str, ...]:
        """Return what keeps lines, or flights of one line, from being quite comparable, a sentence each."""
        said: list[str] = []
        for entrant in self.entrants:
            if found := refusal(entrant.runs):
                said.append(f"Counted together all the same: {found}.")
            if entrant.setting.disturbed:
                said.append(f"{entrant.label} was disturbed on purpose: {entrant.setting.disturbed}.")
            names = {name for each in entrant.scored for name in each.served}
            if len(names) > 1:
                said.append(f"{entrant.label} was served as {', '.join(sorted(names))}.")
        kinds = [{what: told for what, told in identity(e.runs[0]).items() if common(what)} for e in self.entrants]
        apart = {str(found) for kind in kinds[1:] for found in differences(kinds[0], kind)}
        if apart:
            said.append(f"Not all lines were flown alike: they differ in {', '.join(sorted(apart))}.")
        return tuple(said)


def common(what: str) -> bool:
    """Return whether lines that stand together should agree in this part of their identity, whoever flew."""
    return what in ("the code", "the camera", "the clock") or what.startswith(
        ("the protocol", "the suite", "the version")
    )


def what_it_is(pilot: str) -> str:
    """Return what a built-in pilot is, a sentence; empty: not known."""
    kind, _, name = pilot.partition(":")
    if pilot in OURS:
        return f"{pilot} {OURS[pilot]}."
    if kind == "failing" and name in FAILURES:
        return f"{pilot} fails on purpose: it {FAILURES[name].description}."
    if kind == "blind" and name in PATTERNS:
        return f"{pilot} sees nothing: {PATTERNS[name].description}."
    return f"{pilot} says recorded replies again." if kind == "recorded" else ""


def floor(table: BlindTable, flown: Iterable[str]) -> tuple[str, int, int] | None:
    """Return (pilot, solved, flown) of the blind pilot that solved most of these episodes; None: none flew them all."""
    ids = sorted(set(flown))
    solved = [
        (pilot, sum(flights[episode].success for episode in ids), len(ids))
        for pilot, flights in sorted(table.items())
        if all(episode in flights for episode in ids)
    ]
    return max(solved, key=lambda each: each[1], default=None) if ids else None


def titled(cell: str) -> str:
    """Return a cell's name as a head: Search-and-Track."""
    return "-".join(word if word == "and" else word.capitalize() for word in cell.split("-"))


def _marked(rows: Sequence[TableRow], columns: Sequence[TableColumn]) -> tuple[TableRow, ...]:
    """Return the rows with the best cell of each column marked where one way is good and not all are alike."""
    best: Mapping[int, float] = {
        k: (max if column.better == "more" else min)(values)
        for k, column in enumerate(columns)
        if column.better and len(set(values := [v for row in rows if (v := _number(row.cells[k])) is not None])) > 1
    }
    return tuple(
        replace(row, cells=tuple(
            replace(cell, best=k in best and _number(cell) == best[k]) for k, cell in enumerate(row.cells)
        ))
        for row in rows
    )  # fmt: skip


def _number(cell: TableCell) -> float | None:
    return cell.value if isinstance(cell.value, int | float) else None
