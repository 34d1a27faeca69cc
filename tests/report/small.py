"""A small synthetic benchmark. Every number of its report can be counted by hand."""

from collections.abc import Callable

from dronecats.report.report_data import ReportData, entrants
from dronecats.report.results.collection import Collection, Usage
from dronecats.report.table import ReportTable, TableCell
from episodes.records.catalogue import BlindFlight
from tests.support.scores import a_run, an_episode, collected, flights, named

COMMAND = "dronecats report runs --out report"
GOOD, BAD = "vllm/good", "vllm/bad"
ASKED = Usage(questions=10, tokens_in=1000, tokens_out=100)
PRICED = {"input_usd": 1.0, "output_usd": 10.0}  # ASKED costs 0.002 $


def benchmark() -> Collection:
    """Return two flights of one model, one flight of another model, and the flights of two built-in pilots."""
    some = []
    for seed, approaching in enumerate(("ssfs", "sffs")):
        run = a_run(f"runs/good-{seed}", model=named("good", **PRICED), seed=seed)
        some.append(flights(run, {"campus-approaching": approaching[:2], "residential-approaching": approaching[2:],
                                  "campus-tracking": "fe"[seed]}, usage=ASKED))  # fmt: skip
        some.append([_commanded(run, seed)])
    run = a_run("runs/bad", model=named("bad"))
    some.append(flights(run, {"campus-approaching": "ff", "residential-approaching": "fs", "campus-tracking": "f"}))
    some.append(flights(a_run("runs/oracle", pilot="oracle"), {"campus-approaching": "ss", "campus-tracking": "s"}))
    some.append(flights(a_run("runs/blind", pilot="blind:fan"), {"campus-approaching": "sf"}))
    return collected(*some)


def _commanded(run, seed):
    """Return a commanding flight. With seed 0, one of four drones is at the target; with other seeds, none is."""
    drones = {"drones_found": 1, "drones_beside": 2, "drones_elsewhere": 0, "drones_silent": 1}
    lost = {"drones_found": 0, "drones_beside": 1, "drones_elsewhere": 1, "drones_silent": 2, "declared": True}
    won = seed == 0
    return an_episode(run, "blocks-commanding-01", "success" if won else "failure", values=drones if won else lost)


def blind_table():
    """Return the scores of blind pilots: the fan flew every approaching episode, the ring only one."""
    solved = BlindFlight(success=True, first=False, within_three=False, declarations=9, false_declarations=8, steps=9)
    lost = BlindFlight(success=False, first=False, within_three=False, declarations=9, false_declarations=9, steps=9)
    ids = [f"{place}-approaching-{k:02}" for place in ("campus", "residential") for k in (1, 2)]
    return {"blind:fan": {**dict.fromkeys(ids, lost), ids[0]: solved}, "blind:ring": {ids[0]: solved}}


def small(collection: Collection | None = None, **options: bool) -> ReportData:
    """Return the report data of a collection, by default of the synthetic benchmark."""
    rows = entrants(collection or benchmark(), **options)
    return ReportData(entrants=rows, blind=blind_table(), command=COMMAND)


def line(table: ReportTable, name: str, nth: int = 0) -> dict[str, TableCell]:
    """Return the cells, by column name, of the nth row whose entrant or first cell is `name`."""
    rows = [row for row in table.rows if name in (row.entrant, row.cells[0].value)]
    return {column.name: cell for column, cell in zip(table.columns, rows[nth].cells, strict=True)}


def made(table: Callable[[ReportData], ReportTable | None], data: ReportData) -> ReportTable:
    """Compute a table, which must exist."""
    result = table(data)
    assert result is not None
    return result


def number(value: str | float | None) -> float:
    """Return the value, which must be a number."""
    assert isinstance(value, int | float)
    return value
