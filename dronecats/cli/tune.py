"""`dronecats tune AIRFRAME`: the gains that an airframe is given, and how far each of its loops is from trouble."""

import argparse
import json
import math
from pathlib import Path
from typing import Any


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("tune")
    parser.add_argument("airframe", help="the name of an airframe, or a TOML file that describes one")
    parser.add_argument("--out", type=Path, metavar="DIR", help="draw Bode and step plots into this folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print gains and margins; status 0, or 2 when the airframe cannot be controlled."""
    from autopilot.design.loop_pictures import draw, step_figures
    from autopilot.design.loop_shaping import design, margins_by_control
    from vehicles import airframe

    frame = airframe.load(args.airframe)
    gains = design(frame)
    found: dict[str, Any] = {
        "airframe": frame.name,
        "hover_thrust": round(gains.hover_thrust, 4),
        "gains": _gains(gains),
        "loops": {},
    }
    checked = margins_by_control(frame, gains)
    figures = step_figures(frame, gains)
    for name, margin in gains.margins.items():
        found["loops"][name] = {
            "phase_margin_deg": round(margin.phase_deg, 1),
            "gain_margin_db": round(margin.gain_db, 1) if math.isfinite(margin.gain_db) else None,
            "crossover_rad_s": round(margin.crossover, 3),
            "phase_margin_by_control_deg": round(checked[name].phase_deg, 1),
            **figures[name],
        }
    if args.out:
        found["plots"] = [str(path) for path in draw(frame, gains, args.out)]
    print(json.dumps(found) if args.json else _text(found))
    return 0


def _gains(gains: Any) -> dict[str, Any]:
    names = ("rate_p", "rate_i", "rate_d", "attitude_p", "velocity_p", "velocity_i", "velocity_d", "position_p")
    return {name: [float(f"{value:.4g}") for value in getattr(gains, name)] for name in names}


def _text(found: dict[str, Any]) -> str:
    lines = [f"{found['airframe']}: hovers at {found['hover_thrust']:.1%} of its full thrust", ""]
    lines.append(f"{'gain':12} {'roll, north':>12} {'pitch, east':>12} {'yaw, down':>12}")
    for name, values in found["gains"].items():
        lines.append(f"{name:12} " + " ".join(f"{value:12.4g}" for value in values))
    lines += [
        "",
        f"{'loop':20} {'phase':>7} {'gain':>9} {'crossover':>12} {'bandwidth':>12} {'rise':>8} {'overshoot':>10}",
    ]
    for name, loop in found["loops"].items():
        gain = "∞" if loop["gain_margin_db"] is None else f"{loop['gain_margin_db']:.1f}"
        lines.append(
            f"{name:20} {loop['phase_margin_deg']:6.1f}° {gain:>6} dB {loop['crossover_rad_s']:6.2f} rad/s"
            f" {loop['bandwidth_rad_s']:6.2f} rad/s {loop['rise_s']:6.3f} s {loop['overshoot_percent']:8.1f} %"
        )
    lines += ["", *found.get("plots", ())]
    return "\n".join(lines).rstrip()
