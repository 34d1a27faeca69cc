"""The study of the loops as a page of Markdown, with its figures beside it and the command that makes them."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dronecats.report.table import CellValue, ReportTable, numbers, table_of, words
from dronecats.report.writers import as_markdown
from dronecats.study.loop import pictures
from dronecats.study.loop.results import LoopResults, as_json, margin_rows, stream_rows, trace_rows, write_csv
from dronecats.study.loop.stream import Tolerance
from foundation.errors import InfrastructureError

NAME = "loop-margins"
MARGINS = """A loop is stepped by a little in a hover, what is outside it open and what is inside it closed, by sensors
that do not err. A delay line lies in its feedback alone. The delay margin is where the damping ratio of the
oscillation that the step leaves, by the matrix pencil, crosses 0. Beside it, what python-control has of the same
cascade linearised about the same hover, and of the loops as `dronecats tune` draws them, on the airframe's constants
alone (as designed)."""
STREAM = """A circle of 1.2 m/s in ten seconds, asked for twenty times a second over a wire that delays each setpoint by
up to so much, or loses so many. Borne, until the rms error of the velocity is twice that on a perfect wire, or offboard
is left (COM_OF_LOSS_T, 1 s) in any of three flights; dotted."""
TRACE = (
    "Velocity setpoints from a stand, twenty a second and nothing else, sensors that err as ever; figures of the truth."
    " Rise is from 10 to 90 %, delay until a half is there, settled when it stays within a tenth of the step."
)


STEP = {"rise": ("rise_s", "g", " s"), "overshoot": ("overshoot_percent", "g", " %"), "delay": ("delay_s", "g", " s")}
DELAYS = {"as designed": ("designed_ms", "g", " ms"), "predicted": ("predicted_ms", "g", " ms"),
          "injected": ("injected_ms", "g", " ms"), "off": ("off_percent", "+.1f", " %")}  # fmt: skip
SETTLED = {"settled": ("settled_s", "g", " s")}


def tables(found: LoopResults) -> list[ReportTable]:
    """Return the margins, what streams of setpoints bear, and the steps, those that were studied."""
    made = []
    if found.studies:
        made.append(_table(("airframe", "loop"), {**STEP, **DELAYS}, margin_rows(found.studies)))
    if found.tolerances:
        heads = ("error on a perfect wire", "twice that at", "offboard left from")
        made.append(table_of([words("airframe"), words("stream"), *map(numbers, heads)], map(_borne, found.tolerances)))
    if found.traces:
        made.append(_table(("autopilot", "step"), {**STEP, **SETTLED}, trace_rows(found.traces)))
    return made


def _table(
    names: Sequence[str], measures: Mapping[str, tuple[str, str, str]], rows: Iterable[Mapping[str, Any]]
) -> ReportTable:
    """Return a table of rows; `measures` are (field, format, unit) by their heads."""
    lines = (
        (*(row[name] for name in names),
         *("–" if row[field] is None else f"{row[field]:{form}}{unit}" for field, form, unit in measures.values()))
        for row in rows
    )  # fmt: skip
    return table_of([*map(words, names), *map(numbers, measures)], lines)


def write(found: LoopResults, out: Path, command: str) -> list[Path]:
    """Write page, figures, JSON and CSV into a folder and return their paths. Raises InfrastructureError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        pngs = pictures.draw(found, out, command)
        written = [out / f"{NAME}.md", out / f"{NAME}.json"]
        written[0].write_text(_page(found, pngs, command), encoding="utf-8")
        written[1].write_text(json.dumps(as_json(found), indent=1) + "\n", encoding="utf-8")
    except OSError as full:
        raise InfrastructureError(f"{out} cannot be written: {full.strerror}") from None
    rows = {
        "margins": margin_rows(found.studies),
        "stream": stream_rows(found.tolerances),
        "trace": trace_rows(found.traces),
    }
    for name, table_rows in rows.items():
        if table_rows:
            write_csv(table_rows, out / f"{name}.csv")
            written.append(out / f"{name}.csv")
    return [*written, *(path.with_suffix(kind) for path in pngs.values() for kind in (".png", ".svg", ".pdf"))]


def _page(found: LoopResults, pngs: dict[str, Path], command: str) -> str:
    parts = ["# Margins of the loops", f"Made by `{command}`.", *([MARGINS] if found.studies else [])]
    told = {"margins": "Predicted and injected delay margins.", "steps": "Small steps, nothing late.",
            "onset": "Below, at and above the injected margin.", "stream": STREAM, "trace": TRACE}  # fmt: skip
    parts += [f"![{name}]({path.name})\n\n{told[name]}" for name, path in pngs.items()]
    return "\n\n".join([*parts, "\n".join(map(as_markdown, tables(found)))])


def _borne(each: Tolerance) -> tuple[CellValue, ...]:
    def level(value: float | None) -> str:
        return "never" if value is None else f"{value:.2f} s" if each.impairment == "jitter" else f"{value:.0%}"

    return each.airframe, each.impairment, f"{each.perfect:.2f} m/s", level(each.doubled), level(each.left)
