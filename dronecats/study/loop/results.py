"""What a study of the loops found, as rows: for JSON, for CSV and for the tables of its page."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.study.loop.margins import LoopStudy, StepFigures
from dronecats.study.loop.stream import Tolerance
from dronecats.study.loop.trace import FlownTrace
from foundation.errors import InfrastructureError

LoopRow = dict[str, Any]


@dataclass(frozen=True, slots=True)
class LoopResults:
    """All of it; empty where it was not asked for."""

    studies: Sequence[LoopStudy] = ()
    tolerances: Sequence[Tolerance] = ()
    traces: Sequence[FlownTrace] = ()  # of the first airframe: ours, and PX4's where there is one
    traced: str = ""  # that airframe


def margin_rows(studies: Sequence[LoopStudy]) -> list[LoopRow]:
    """Return a row a loop: its step, and its delay margins in ms with the frequencies (rad/s) of the oscillation."""
    return [
        {
            "airframe": each.airframe,
            "loop": each.loop.name,
            **_figures(each.step),
            "designed_ms": _milliseconds(each.designed.delay_s),
            "predicted_ms": _milliseconds(each.predicted.delay_s),
            "predicted_rad_s": round(each.predicted.frequency, 3),
            "injected_ms": _milliseconds(each.injected.delay_s),
            "injected_rad_s": round(each.injected.frequency, 3),
            "off_percent": round(100.0 * each.off, 1),
        }
        for each in studies
    ]


def stream_rows(tolerances: Sequence[Tolerance]) -> list[LoopRow]:
    """Return a row for each level of jitter (s) and loss (share) of each airframe."""
    return [
        {
            "airframe": each.airframe,
            "impairment": each.impairment,
            "level": level,
            "error_m_s": _finite(error),
            "error_ratio": _finite(error / each.perfect),
            "left_offboard": sum(trial.left_s is not None for trial in trials),
            "flights": len(trials),
        }
        for each in tolerances
        for level, error, trials in zip(each.levels, each.errors, each.trials, strict=True)
    ]


def trace_rows(traces: Sequence[FlownTrace]) -> list[LoopRow]:
    """Return a row for each step of the trace and each autopilot."""
    return [
        {"autopilot": trace.autopilot, "step": name, **_figures(figures), "settled_s": _finite(figures.settled_s)}
        for trace in traces
        for name, figures in trace.steps()
    ]


def as_json(found: LoopResults) -> LoopRow:
    """Return everything but the curves."""
    return {
        "loops": margin_rows(found.studies),
        "streams": [
            {"airframe": t.airframe, "impairment": t.impairment, "doubled_at": t.doubled, "left_offboard_at": t.left}
            for t in found.tolerances
        ],
        "stream_levels": stream_rows(found.tolerances),
        "trace": {"airframe": found.traced, "steps": trace_rows(found.traces)},
    }


def write_csv(rows: Sequence[LoopRow], path: Path) -> None:
    """Write rows of equal fields. Raises InfrastructureError."""
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    except OSError as full:
        raise InfrastructureError(f"{path} cannot be written: {full.strerror}") from None


def _figures(step: StepFigures) -> LoopRow:
    return {
        "rise_s": _finite(step.rise_s),
        "overshoot_percent": _finite(step.overshoot_percent, 1),
        "delay_s": _finite(step.delay_s),
    }


def _milliseconds(seconds: float) -> float | None:
    return _finite(1e3 * seconds, 1)


def _finite(value: float, digits: int = 3) -> float | None:
    return round(value, digits) if math.isfinite(value) else None
