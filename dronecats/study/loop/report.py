"""Writes the report of a loop study: rows as JSON and CSV, figures, and a Markdown page."""

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dronecats.report import figures as style
from dronecats.report.table import CellValue, ReportTable, numbers, table_of, words
from dronecats.report.writers import as_markdown
from dronecats.study.loop.margins import LoopStudy, StepFigures
from dronecats.study.loop.stream import ERROR_RATIO_LIMIT, Tolerance
from dronecats.study.loop.trace import AXES, TraceResponse
from dronecats.study.report import panels
from foundation.errors import InfrastructureError

LoopRow = dict[str, Any]


@dataclass(frozen=True, slots=True)
class LoopResults:
    """The results of a loop study. A part that was not studied is empty."""

    studies: Sequence[LoopStudy] = ()
    tolerances: Sequence[Tolerance] = ()
    traces: Sequence[TraceResponse] = ()  # one airframe with our autopilot, and with PX4 if it was started
    traced: str = ""  # name of the airframe of the traces


def margin_rows(studies: Sequence[LoopStudy]) -> list[LoopRow]:
    """Return a row per loop: rise, overshoot, delay of a step; delay margins (ms); oscillation frequencies (rad/s)."""
    return [
        {
            "airframe": study.airframe,
            "loop": study.loop.name,
            **_step_fields(study.step),
            "designed_ms": _milliseconds(study.designed.delay_s),
            "predicted_ms": _milliseconds(study.predicted.delay_s),
            "predicted_rad_s": round(study.predicted.frequency, 3),
            "injected_ms": _milliseconds(study.injected.delay_s),
            "injected_rad_s": round(study.injected.frequency, 3),
            "off_percent": round(100.0 * study.prediction_error, 1),
        }
        for study in studies
    ]


def stream_rows(tolerances: Sequence[Tolerance]) -> list[LoopRow]:
    """Return a row per airframe and level of jitter (s) or loss (share)."""
    return [
        {
            "airframe": tolerance.airframe,
            "impairment": tolerance.impairment,
            "level": level,
            "error_m_s": _finite(error),
            "error_ratio": _finite(error / tolerance.perfect_error),
            "left_offboard": sum(trial.left_s is not None for trial in trials),
            "flights": len(trials),
        }
        for tolerance in tolerances
        for level, error, trials in zip(tolerance.levels, tolerance.errors, tolerance.trials, strict=True)
    ]


def trace_rows(traces: Sequence[TraceResponse]) -> list[LoopRow]:
    """Return a row for each step of the trace and each autopilot."""
    return [
        {"autopilot": trace.autopilot, "step": name, **_step_fields(figures), "settled_s": _finite(figures.settled_s)}
        for trace in traces
        for name, figures in trace.steps()
    ]


def as_json(results: LoopResults) -> LoopRow:
    """Return all results except the curves."""
    return {
        "loops": margin_rows(results.studies),
        "streams": [
            {
                "airframe": t.airframe,
                "impairment": t.impairment,
                "doubled_at": t.doubled_at,
                "left_offboard_at": t.left_offboard_at,
            }
            for t in results.tolerances
        ],
        "stream_levels": stream_rows(results.tolerances),
        "trace": {"airframe": results.traced, "steps": trace_rows(results.traces)},
    }


def _step_fields(step: StepFigures) -> LoopRow:
    return {
        "rise_s": _finite(step.rise_s),
        "overshoot_percent": _finite(step.overshoot_percent, 1),
        "delay_s": _finite(step.delay_s),
    }


def _milliseconds(seconds: float) -> float | None:
    return _finite(1e3 * seconds, 1)


def _finite(value: float, digits: int = 3) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


NAME = "loop-margins"
MARGINS = """A small step of the setpoint in a hover, with the outer loops open, the inner loops closed, and perfect
sensors. Only the feedback of this loop is delayed. At the delay margin the damping ratio of the oscillation after the
step (by the matrix pencil) is 0. The other margins are by python-control. Predicted: from the same cascade, linearised
about the same hover. Designed: from the loops of `dronecats tune`, with the airframe's constants only. Prediction
error: of the injected delay margin."""
STREAM = """A circle of 1.2 m/s in ten seconds, commanded twenty times a second over a link that delays each setpoint by
up to the jitter, or loses a share of them. The limit is twice the rms velocity error on a perfect link, or the end of
Offboard (COM_OF_LOSS_T, 1 s) in any of three flights (dotted)."""
TRACE = (
    "Velocity setpoints from a standstill, twenty a second, with the usual sensor errors. The values are true"
    " values. Rise: time from 10 to 90 % of the step. Delay: time to 50 %. Settled: time until it stays within 10 %"
    " of the step."
)


STEP = {"rise": ("rise_s", "g", " s"), "overshoot": ("overshoot_percent", "g", " %"), "delay": ("delay_s", "g", " s")}
DELAYS = {"designed": ("designed_ms", "g", " ms"), "predicted": ("predicted_ms", "g", " ms"),
          "injected": ("injected_ms", "g", " ms"), "prediction error": ("off_percent", "+.1f", " %")}  # fmt: skip
SETTLED = {"settled": ("settled_s", "g", " s")}


def tables(results: LoopResults) -> list[ReportTable]:
    """Return the tables of margins, stream tolerances and trace steps. Parts that were not studied have no table."""
    report_tables = []
    if results.studies:
        report_tables.append(_table(("airframe", "loop"), {**STEP, **DELAYS}, margin_rows(results.studies)))
    if results.tolerances:
        heads = ("error on a perfect link", "error doubled at", "offboard ends at")
        report_tables.append(
            table_of(
                [words("airframe"), words("stream"), *map(numbers, heads)], map(_tolerance_cells, results.tolerances)
            )
        )
    if results.traces:
        report_tables.append(_table(("autopilot", "step"), {**STEP, **SETTLED}, trace_rows(results.traces)))
    return report_tables


def _table(
    names: Sequence[str], measures: Mapping[str, tuple[str, str, str]], rows: Iterable[Mapping[str, Any]]
) -> ReportTable:
    """Return a table of rows; `measures` maps column heads to (field, format, unit)."""
    lines = (
        (*(row[name] for name in names),
         *("–" if row[field] is None else f"{row[field]:{form}}{unit}" for field, form, unit in measures.values()))
        for row in rows
    )  # fmt: skip
    return table_of([*map(words, names), *map(numbers, measures)], lines)


def write(results: LoopResults, out: Path, command: str) -> list[Path]:
    """Write the page, figures, JSON and CSV files into a folder and return their paths. Raises InfrastructureError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        pngs = draw(results, out, command)
        written = [out / f"{NAME}.md", out / f"{NAME}.json"]
        written[0].write_text(_page(results, pngs, command), encoding="utf-8")
        written[1].write_text(json.dumps(as_json(results), indent=1) + "\n", encoding="utf-8")
        by_name = (("margins", margin_rows(results.studies)), ("stream", stream_rows(results.tolerances)),
                   ("trace", trace_rows(results.traces)))  # fmt: skip
        for name, rows in by_name:
            if rows:
                written.append(out / f"{name}.csv")
                with written[-1].open("w", newline="", encoding="utf-8") as file:
                    writer = csv.DictWriter(file, list(rows[0]))
                    writer.writeheader()
                    writer.writerows(rows)
    except OSError as error:
        raise InfrastructureError(f"{error.filename or out} cannot be written: {error.strerror}") from None
    return [*written, *(path.with_suffix(kind) for path in pngs.values() for kind in (".png", ".svg", ".pdf"))]


def _page(results: LoopResults, pngs: dict[str, Path], command: str) -> str:
    paragraphs = ["# Margins of the loops", f"Made by `{command}`.", *([MARGINS] if results.studies else [])]
    captions = {"margins": "Predicted and injected delay margins.", "steps": "Small steps without delay.",
            "onset": "Below, at and above the injected margin.", "stream": STREAM, "trace": TRACE}  # fmt: skip
    paragraphs += [f"![{name}]({path.name})\n\n{captions[name]}" for name, path in pngs.items()]
    return "\n\n".join([*paragraphs, "\n".join(map(as_markdown, tables(results)))])


def _tolerance_cells(tolerance: Tolerance) -> tuple[CellValue, ...]:
    def level(value: float | None) -> str:
        return "never" if value is None else f"{value:.2f} s" if tolerance.impairment == "jitter" else f"{value:.0%}"

    return (
        tolerance.airframe,
        tolerance.impairment,
        f"{tolerance.perfect_error:.2f} m/s",
        level(tolerance.doubled_at),
        level(tolerance.left_offboard_at),
    )


GROUP_COLOURS = {"rate": style.BLUE, "attitude": style.ORANGE, "velocity": style.GREEN}
AGREED = 0.2  # largest prediction error that counts as agreement, as a share of the injected margin
POINTS = 300  # an oscillating curve is thinned to about this many points
SHOWN = ("roll rate", "roll attitude", "horizontal velocity", "vertical velocity")


def draw(results: LoopResults, out: Path, command: str) -> dict[str, Path]:
    """Write the figures of all studied parts as SVG, PDF and PNG, with the command below each. Return name → PNG path.

    Raises InfrastructureError.
    """
    figures = {}
    with style.styled():
        if results.studies:
            figures["margins"] = draw_margins(results.studies)
            figures["steps"] = draw_steps(results.studies)
            figures["onset"] = draw_onset(results.studies)
        if results.tolerances:
            figures["stream"] = draw_stream(results.tolerances)
        if results.traces:
            figures["trace"] = draw_trace(results.traces, results.traced)
        for figure in figures.values():
            figure.supxlabel(command, fontsize=6.0, color=style.GREY)
        return {name: style.save(figure, out, name) for name, figure in figures.items()}


def _panels(rows: int, columns: int, height_in: float, **options: Any) -> tuple[Any, Any]:
    figure = style.canvas(height_in)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def _airframes(studies: Sequence[LoopStudy] | Sequence[Tolerance]) -> list[str]:
    return list(dict.fromkeys(row.airframe for row in studies))


def draw_margins(studies: Sequence[LoopStudy]) -> Any:
    """Return a figure of injected delay margins over predicted ones, with the band of AGREED around equality."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    figure, axes = _panels(1, 1, 3.6)
    axis = axes[0, 0]
    values = 1e3 * np.array([(study.predicted.delay_s, study.injected.delay_s) for study in studies])
    line = np.array([0.7 * values.min(), 1.4 * values.max()])
    axis.fill_between(line, line / (1.0 + AGREED), line / (1.0 - AGREED), color=style.LIGHT, linewidth=0.0)
    axis.plot(line, line, color=style.GREY, linewidth=0.8)
    names = _airframes(studies)
    for study in studies:
        axis.plot(
            1e3 * study.predicted.delay_s, 1e3 * study.injected.delay_s, linestyle="none", markersize=5.0,
            marker=panels.marker(names.index(study.airframe)), color=GROUP_COLOURS[study.loop.group],
            markerfacecolor="none",
        )  # fmt: skip
    for group in dict.fromkeys(study.loop.group for study in studies):
        axis.plot([], [], linestyle="none", marker="o", color=GROUP_COLOURS[group], label=f"{group} loops")
    for k, name in enumerate(names):
        axis.plot([], [], linestyle="none", marker=panels.marker(k), color=style.INK, label=name,
                  markerfacecolor="none")  # fmt: skip
    axis.fill_between([], [], [], color=style.LIGHT, label=f"within {AGREED:.0%}")
    axis.set(
        xscale="log", yscale="log", xlim=line, ylim=line,
        xlabel="delay margin that python-control predicts (ms)", ylabel="injected delay that oscillates (ms)",
    )  # fmt: skip
    ticks = [tick for tick in (10, 20, 50, 100, 200, 500, 1000) if line[0] <= tick <= line[1]]
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_locator(FixedLocator(ticks))
        scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        scale.set_minor_formatter(NullFormatter())
    axis.legend(loc="upper left")
    return figure


def draw_steps(studies: Sequence[LoopStudy]) -> Any:
    """Return a figure of the step responses without delay: a panel per loop of SHOWN, a curve per airframe."""
    shown = [name for name in SHOWN if any(study.loop.name == name for study in studies)] or [studies[0].loop.name]
    figure, axes = _panels(1, len(shown), 2.0, sharey=True)
    names = _airframes(studies)
    for axis, name in zip(axes[0], shown, strict=True):
        for study in studies:
            if study.loop.name == name:
                response, k = study.responses[0.0], names.index(study.airframe)
                axis.plot(response.time, response.value / response.step, color=panels.colour(k), linewidth=0.9,
                          label=study.airframe)  # fmt: skip
        axis.axhline(1.0, color=style.GREY, linewidth=0.6)
        axis.set(title=name, xlabel="s")
    axes[0, 0].set_ylabel("share of the step")
    axes[0, -1].legend(loc="lower right")
    return figure


def draw_onset(studies: Sequence[LoopStudy]) -> Any:
    """Return a figure of the first airframe's oscillations with delays below, at and above the injected margins."""
    first = [study for study in studies if study.airframe == studies[0].airframe]
    shown = [study for study in first if study.loop.name in SHOWN] or first[:1]
    figure, axes = _panels(3, len(shown), 4.0, sharex="col", sharey=True)
    for column, study in zip(axes.T, shown, strict=True):
        late = [delay_s for delay_s in study.responses if delay_s > 0.0]
        for axis, delay_s, colour in zip(column, late, (style.GREEN, style.INK, style.VERMILION), strict=True):
            response = study.responses[delay_s]
            thin = max(len(response.time) // POINTS, 1)
            axis.plot(response.time[::thin], response.value[::thin] / response.step, color=colour, linewidth=0.7)
            axis.set_title(f"{1e3 * delay_s:.0f} ms, {delay_s / study.injected.delay_s:.1f} ×", fontsize=7.0)
            axis.set_ylim(-3.0, 5.0)
        column[0].set_title(f"{study.loop.name}\n{column[0].get_title()}", fontsize=7.0)
        column[-1].set_xlabel("s")
    figure.supylabel(f"share of the step, {studies[0].airframe}", fontsize=8.0)
    return figure


def draw_stream(tolerances: Sequence[Tolerance]) -> Any:
    """Return a figure of the tracking error over jitter and loss, with the levels at which offboard mode ends."""
    kinds = list(dict.fromkeys(tolerance.impairment for tolerance in tolerances))
    figure, axes = _panels(1, len(kinds), 2.4, sharey=True)
    names = _airframes(tolerances)
    labels = {"jitter": "jitter of the setpoints (s)", "loss": "share of setpoints lost"}
    for axis, kind in zip(axes[0], kinds, strict=True):
        for tolerance in tolerances:
            if tolerance.impairment != kind:
                continue
            k = names.index(tolerance.airframe)
            ratio = np.array(tolerance.errors) / tolerance.perfect_error
            stays = [all(trial.left_s is None for trial in trials) for trials in tolerance.trials]
            colour = panels.colour(k)
            axis.plot(np.array(tolerance.levels)[stays], ratio[stays], marker=panels.marker(k), markersize=3.0,
                      linewidth=0.9, color=colour, label=tolerance.airframe)  # fmt: skip
            if tolerance.left_offboard_at is not None:
                axis.axvline(
                    tolerance.left_offboard_at, color=colour, linewidth=1.2, linestyle=(2 * k, (2, 2 * len(names) - 2))
                )
        axis.axhline(ERROR_RATIO_LIMIT, color=style.GREY, linewidth=0.6)
        axis.set_xlabel(labels.get(kind, kind))
    axes[0, 0].set_ylabel("tracking error, × a perfect link")
    axes[0, 0].legend(loc="upper left")
    return figure


def draw_trace(traces: Sequence[TraceResponse], airframe: str) -> Any:
    """Return a figure of the setpoint trace and of the response of each autopilot."""
    figure, axes = _panels(len(AXES), 1, 4.0, sharex=True)
    for k, (axis, name) in enumerate(zip(axes[:, 0], AXES, strict=True)):
        axis.plot(traces[0].time, traces[0].setpoints[:, k], color=style.GREY, linewidth=0.8, label="setpoint")
        for response, colour in zip(traces, panels.COLOURS, strict=False):
            label = {"ours": "our autopilot", "px4": "PX4"}[response.autopilot]
            axis.plot(response.time, response.measured[:, k], color=colour, linewidth=0.9, label=label)
        axis.set_ylabel(f"{name} ({'rad/s' if name == 'yaw rate' else 'm/s'})")
    axes[0, 0].set_title(airframe)
    axes[0, 0].legend(loc="upper right")
    axes[-1, 0].set_xlabel("s")
    return figure
