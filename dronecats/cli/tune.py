"""Verb `tune`: computes the controller gains of an airframe and the loops' stability margins."""

import argparse
import json
import math
from pathlib import Path
from typing import Any

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import show
from dronecats.report.table import ReportTable, numbers, table_of, words


def add_tune_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("airframe", metavar="NAME|FILE", help="name of an airframe, or a TOML file that describes one")
    parser.add_argument("--out", type=Path, metavar="DIR", help="draw Bode and step plots into this folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print gains and margins. Raises UsageError if the airframe cannot be controlled."""
    from autopilot.control.loop_design import design, draw, margins_by_control, step_figures
    from vehicles import airframe

    frame = airframe.load(args.airframe)
    gains = design(frame)
    result: dict[str, Any] = {
        "airframe": frame.name,
        "hover_thrust": round(gains.hover_thrust, 4),
        "gains": _gains(gains),
        "loops": {},
    }
    checked = margins_by_control(frame, gains)
    figures = step_figures(frame, gains)
    for name, margin in gains.margins.items():
        result["loops"][name] = {
            "phase_margin_deg": round(margin.phase_deg, 1),
            "gain_margin_db": round(margin.gain_db, 1) if math.isfinite(margin.gain_db) else None,
            "crossover_rad_s": round(margin.crossover, 3),
            "phase_margin_by_control_deg": round(checked[name].phase_deg, 1),
            **figures[name],
        }
    if args.out:
        result["plots"] = [str(path) for path in draw(frame, gains, args.out)]
    if args.json:
        print(json.dumps(result))
    else:
        print(f"{result['airframe']}: hovers at {result['hover_thrust']:.1%} of full thrust\n")
        show(*_tables(result))
        print("\n".join(["", *result.get("plots", ())]), end="\n" * ("plots" in result))
        if not args.out:
            print_next("tune", airframe=args.airframe)
    return 0


def _gains(gains: Any) -> dict[str, Any]:
    names = ("rate_p", "rate_i", "rate_d", "attitude_p", "velocity_p", "velocity_i", "velocity_d", "position_p")
    return {name: [float(f"{value:.4g}") for value in getattr(gains, name)] for name in names}


def _tables(result: dict[str, Any]) -> list[ReportTable]:
    gains = [words("gain"), *(numbers(axis) for axis in ("roll, north", "pitch, east", "yaw, down"))]
    loops = [
        words("loop"), numbers("phase", unit="°", decimals=1), numbers("gain", unit="dB"),
        numbers("crossover", unit="rad/s", decimals=2), numbers("bandwidth", unit="rad/s", decimals=2),
        numbers("rise", unit="s", decimals=3), numbers("overshoot (%)", decimals=1),
    ]  # fmt: skip
    lines = [
        (name, loop["phase_margin_deg"], "∞" if loop["gain_margin_db"] is None else f"{loop['gain_margin_db']:.1f}",
         loop["crossover_rad_s"], loop["bandwidth_rad_s"], loop["rise_s"], loop["overshoot_percent"])
        for name, loop in result["loops"].items()
    ]  # fmt: skip
    values = ((name, *(f"{value:.4g}" for value in axes)) for name, axes in result["gains"].items())
    return [table_of(gains, values), table_of(loops, lines)]
