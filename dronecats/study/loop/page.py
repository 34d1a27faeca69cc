"""What a study of the loops found: rows for JSON and CSV, and a page of Markdown with its figures beside it."""

import json
from pathlib import Path

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


def tables(found: LoopResults) -> list[ReportTable]:
    """Return the margins, what streams of setpoints bear, and the steps, those that were studied."""
    margins = ("airframe", "loop"), ("rise", "overshoot", "delay", "as designed", "predicted", "injected", "off")
    streams = ("airframe", "stream"), ("error on a perfect wire", "twice that at", "offboard left from")
    steps = ("autopilot", "step"), ("rise", "overshoot", "delay", "settled")
    made: list[tuple[tuple[tuple[str, ...], tuple[str, ...]], list[tuple[CellValue, ...]]]] = []
    if found.studies:
        lines = [
            (r["airframe"], r["loop"], _told(r["rise_s"], "s"), _told(r["overshoot_percent"], "%"),
             _told(r["delay_s"], "s"), _told(r["designed_ms"], "ms"), _told(r["predicted_ms"], "ms"),
             _told(r["injected_ms"], "ms"), f"{r['off_percent']:+.1f} %")
            for r in margin_rows(found.studies)
        ]  # fmt: skip
        made.append((margins, lines))
    if found.tolerances:
        made.append((streams, [_borne(each) for each in found.tolerances]))
    if found.traces:
        lines = [
            (r["autopilot"], r["step"], _told(r["rise_s"], "s"), _told(r["overshoot_percent"], "%"),
             _told(r["delay_s"], "s"), _told(r["settled_s"], "s"))
            for r in trace_rows(found.traces)
        ]  # fmt: skip
        made.append((steps, lines))
    return [table_of([*map(words, left), *map(numbers, right)], lines) for (left, right), lines in made]


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


def _told(value: float | None, unit: str) -> str:
    return f"– {unit}" if value is None else f"{value:g} {unit}"
