"""Action `study load`: measures the effect of a busy host on flights in lockstep and in real time."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.options import level_list
from dronecats.cli.output import print_note, show
from foundation.errors import UsageError
from foundation.files import check_folder
from foundation.machine import cores

BUSY = "0,2,4,8"  # default numbers of busy processes
MOST = 256  # largest valid number of busy processes


def add_load_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--busy",
        type=level_list,
        metavar="N,N,…",
        default=level_list(BUSY),
        help=f"numbers of busy processes beside the flights (default {BUSY})",
    )
    parser.add_argument("--episodes", type=level_list, metavar="ID,ID,…", help="these episodes, by id or file")
    parser.add_argument("--suite", action="append", metavar="NAME", help="quick (default), one-drone, commanding, all")
    parser.add_argument("--cells", type=level_list, metavar="CELL,…", help="these cells of the suite (default all)")
    parser.add_argument("--maps", type=level_list, metavar="MAP,…", help="these maps of the suite (default all)")
    parser.add_argument("--pilot", default="oracle", metavar="NAME", help="built in (default oracle)")
    parser.add_argument("--flights", type=int, default=1, metavar="N", help="flights of each episode (default 1)")
    parser.add_argument(
        "--seconds", type=float, default=60.0, metavar="S", help="vehicle time of a flight (default 60)"
    )
    parser.add_argument("--latency", default="fixed:0.1", metavar="POLICY", help="time of a reply (default fixed:0.1)")
    parser.add_argument("--speed", type=float, default=1.0, metavar="N", help="factor on real time (default 1)")
    parser.add_argument("--rendered", action="store_true", help="also render frames for pilots that do not use them")
    parser.add_argument("--jobs", type=int, default=1, metavar="J", help="flights at a time (default 1)")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/study-load"), metavar="DIR",
        help="folder; an unfinished one is resumed (default runs/study-load)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly and compare the flights. Return 1 if the load changed a verdict in lockstep, else 0."""
    from dronecats.agent.latency import LatencyPolicy
    from dronecats.cli.study_spec import suite_of_options
    from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
    from dronecats.pilots import roster
    from dronecats.study import host_load

    interrupt_on_signals()
    if not 1 <= args.jobs <= 64 or not 1 <= args.flights <= 1000:
        raise UsageError("--jobs must be 1 to 64, and --flights 1 to 1000")
    check_folder(args.out)
    args.suite = args.suite or ([] if args.episodes else ["quick"])
    chosen = suite_of_options(args)
    rendered = args.rendered or roster.needs_pictures(args.pilot)
    flight = FlightSpec(
        pilot=args.pilot,
        simulated=Simulated(speed=args.speed, rendered=rendered),
        latency=LatencyPolicy.parse(args.latency),
        seconds=args.seconds,
        full=True,
    )
    flights = host_load.fly(
        flight, tuple(chosen.records), _levels(args.busy),
        flights=args.flights, jobs=args.jobs, out=args.out, progress=print_note,
    )  # fmt: skip
    findings = host_load.compare(flights)
    machine = f"On a machine with {cores()} cores. Other programs may have run on it too."
    written = host_load.write(findings, args.out, _command(args), machine)
    if args.json:
        print(json.dumps({**asdict(findings), "written": [str(path) for path in written]}))
    else:
        show(*host_load.tables(findings))
        print("\n" + "\n".join(str(path) for path in written))
    return int(any(row.moved for row in findings.rows if row.clock == "lockstep"))


def _levels(words: list[str]) -> tuple[int, ...]:
    if not words or not all(word.isascii() and word.isdigit() and int(word) <= MOST for word in words):
        raise UsageError(f"--busy must be whole numbers up to {MOST}, as in {BUSY}, got '{','.join(words):.60}'")
    levels = tuple(int(word) for word in words)
    if len(set(levels)) < len(levels):
        raise UsageError("--busy has a level twice. Remove one")
    return levels


def _command(args: argparse.Namespace) -> str:
    """Return the command that repeats this study."""
    words = ["dronecats study load", f"--busy {','.join(args.busy)}"]
    for name in ("episodes", "cells", "maps"):
        words += [f"--{name} {','.join(getattr(args, name))}"] if getattr(args, name) else []
    words += [f"--suite {name}" for name in args.suite]
    words += [f"--pilot {args.pilot}", f"--flights {args.flights}", f"--seconds {args.seconds:g}"]
    words += [f"--latency {args.latency}", f"--speed {args.speed:g}", f"--jobs {args.jobs}"]
    words += ["--rendered"] if args.rendered else []
    return " ".join([*words, "--out DIR"])
