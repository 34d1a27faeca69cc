"""A study of the host's load as a page of Markdown."""

import json
from collections.abc import Sequence
from pathlib import Path

from dronecats.report.table import CellValue, ReportTable, numbers, table_of, words
from dronecats.report.writers import as_markdown, as_shell
from dronecats.study.load.comparison import LoadFindings, Marking
from foundation.errors import InfrastructureError

NAME = "host-load"
TEXT = """Each episode is flown in lockstep and in real time beside so many processes that do nothing but compute.
Every flight is compared with the same episode and seed in lockstep at the first level: *moved* has another verdict,
*other bytes* another log (in real time all of them: its steps fall on other instants), and the last column is the
median by which the navigation error differs. *Marked* is what `bench` says the host has held up, and `--drop-stalled`
leaves out."""


def tables(found: LoadFindings) -> list[ReportTable]:
    """Return the levels of the load, and how well the mark tells which flights it changed."""
    levels = [words("clock"), *map(numbers, ("busy", "flights", "solved", "moved", "other bytes", "marked",
                                             "steps held up", "NE differs by"))]  # fmt: skip
    rows = (
        (r.clock, r.busy, r.flights, r.solved, r.moved, r.other_bytes, r.marked, f"{r.stalled_steps} of {r.steps}",
         None if r.ne_moved_m is None else f"{r.ne_moved_m:.2f} m")
        for r in found.rows
    )  # fmt: skip
    marks = [words("the mark, in real time"), *map(numbers, ("moved", "marked", "both", "precision", "recall"))]
    lines = [_marking("another verdict", found.of_verdicts)]
    if found.idle_error_m is not None:
        error = f"NE off by more than {found.idle_error_m:.2f} m, the most at the first level"
        lines.append(_marking(error, found.of_errors))
    return [table_of(levels, rows), table_of(marks, lines)]


def _marking(what: str, of: Marking) -> tuple[CellValue, ...]:
    return what, of.moved, of.marked, of.both, _share(of.precision), _share(of.recall)


def _share(told: tuple[float, float, float] | None) -> str | None:
    return None if told is None else f"{100 * told[0]:.0f} % ({100 * told[1]:.0f} … {100 * told[2]:.0f})"


def write(found: LoadFindings, out: Path, command: str, machine: str) -> Sequence[Path]:
    """Write page and JSON into a folder and return their paths. Raises InfrastructureError."""
    page, data = out / f"{NAME}.md", out / f"{NAME}.json"
    try:
        made = "\n".join(map(as_markdown, tables(found)))
        head = f"# A busy host\n\n{as_shell([command])}\n{TEXT}\n\n"
        page.write_text(f"{head}{made}\n{machine}\n", encoding="utf-8")
        data.write_text(json.dumps({"command": command, **found.as_json()}, indent=1) + "\n", encoding="utf-8")
    except OSError as full:
        raise InfrastructureError(f"{out} cannot be written: {full.strerror}") from None
    return page, data
