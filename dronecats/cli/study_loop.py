"""Action `study loop`: measures the delay, setpoint jitter and setpoint loss that the control loops tolerate."""

import argparse
import json
import os
import tempfile
from pathlib import Path

from dronecats.cli.output import print_note, show
from foundation.errors import UsageError
from foundation.files import check_folder

EXPERIMENTS = ("margins", "stream", "trace")


def add_loop_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--airframe", action="append", metavar="NAME", help="airframe, by name or TOML file; repeatable (default: all)"
    )
    parser.add_argument(
        "--loops",
        action="append",
        metavar="LOOP",
        help="loops: rate, attitude, velocity, or a name as in `dronecats tune`; repeatable",
    )
    parser.add_argument(
        "--part", action="append", choices=EXPERIMENTS, help="only this experiment; repeatable (default: all)"
    )
    parser.add_argument(
        "--px4",
        metavar="COMMAND",
        help="command that starts a PX4, to fly the trace with it too (default: DRONECATS_PX4)",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for page, figures, JSON and CSV")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the experiments. Return 1 if a predicted delay margin is more than 20 % off the measured one, else 0."""
    from dronecats.study.loop import margins, report, stream, trace
    from dronecats.study.loop.hover import Hover, select_loops
    from vehicles import airframe

    loops, experiments = select_loops(args.loops), args.part or EXPERIMENTS
    if args.px4 is not None and not args.px4.strip():
        raise UsageError("--px4 is empty. Give the command that starts a PX4")
    if args.px4 and "trace" not in experiments:
        raise UsageError("--px4 goes with --part trace. Add it, or leave --px4 out")
    if args.out:
        check_folder(args.out)
    frames = [airframe.load(name) for name in args.airframe or airframe.names()]
    studies: list[margins.LoopStudy] = []
    tolerances: list[stream.Tolerance] = []
    traces: list[trace.TraceResponse] = []
    traced = (args.airframe or [trace.AIRFRAME])[0]
    px4 = args.px4 or os.environ.get("DRONECATS_PX4")
    if px4 and "trace" in experiments:  # first, so that a wrong command fails at once
        airframe.require_quadrotor(airframe.load(traced))
        print_note(f"{traced}: the trace under PX4 …")
        log_dir = args.out or Path(tempfile.mkdtemp(prefix="dronecats-px4-log-"))
        log_dir.mkdir(parents=True, exist_ok=True)
        traces.append(trace.fly(traced, px4=px4, log_dir=log_dir))
    for frame in frames:
        if "margins" in experiments:
            print_note(f"{frame.name}: {len(loops)} loops …")
            studies += margins.study_loops(Hover(frame), loops)
        if "stream" in experiments:
            print_note(f"{frame.name}: jitter and loss of the setpoints …")
            tolerances += stream.tolerances(frame)
    if "trace" in experiments:
        print_note(f"{traced}: the trace …")
        traces.insert(0, trace.fly(traced))
    results = report.LoopResults(studies, tolerances, traces, airframe.load(traced).name)
    written = report.write(results, args.out, _command(args)) if args.out else []
    if args.json:
        print(json.dumps({**report.as_json(results), "written": [str(path) for path in written]}))
    else:
        show(*report.tables(results))
        if written:
            print("\n" + "\n".join(str(path) for path in written))
    return int(any(abs(study.prediction_error) > report.AGREED for study in studies))


def _command(args: argparse.Namespace) -> str:
    """Return the command that repeats this study."""
    words = ["dronecats study loop"]
    for name in ("airframe", "loops", "part"):
        words += [f'--{name} "{value}"' if " " in value else f"--{name} {value}" for value in getattr(args, name) or ()]
    if args.px4:
        words.append('--px4 "COMMAND"')
    return " ".join([*words, "--out DIR"])
