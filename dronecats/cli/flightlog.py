"""`dronecats flightlog`: what is left of a real flight: its logs on board, and the trace that they allow."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import Drawing, show
from foundation.errors import UsageError

if TYPE_CHECKING:
    from dronecats.report.table import ReportTable
    from hil.link.flight_logs import FlightLog


def add_flightlog_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    what = parser.add_subparsers(dest="what", metavar="list|fetch|trace", required=True)
    listing = what.add_parser("list", help="say which logs there are on board")
    fetching = what.add_parser("fetch", help="download one")
    tracing = what.add_parser("trace", help="derive the pose trace of a flight without truth, and judge it by that")
    for each in (listing, fetching):
        each.add_argument("--connect", required=True, metavar="URL", help="udpin://0.0.0.0:14550, serial://…")
        each.add_argument("--json", action="store_true", help="print one JSON object")
    fetching.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where to (default: here)")
    fetching.add_argument("--log", type=int, metavar="N", help="its number on board (default: the newest)")
    tracing.add_argument("run_dir", type=Path, help="a run folder of one episode, or the folder of the episode")
    tracing.add_argument("--ulog", type=Path, metavar="FILE", help="the autopilot's own log (default: flight.tlog)")
    tracing.add_argument("--target", metavar="LAT,LON[,ALT]", help="its centre as surveyed; ALT above mean sea level")
    tracing.add_argument("--target-std", type=float, metavar="M", help="how well, per axis (3, a handheld receiver)")
    tracing.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List the logs, fetch one, or derive a trace."""
    return _trace(args) if args.what == "trace" else _on_board(args)


def _on_board(args: argparse.Namespace) -> int:
    from hil.link.flight_logs import log_store

    with log_store(args.connect) as store:
        logs = store.entries()
        if args.what == "list":
            if args.json:
                print(json.dumps({"logs": [asdict(log) for log in logs]}))
            elif logs:
                show(_table(logs))
            else:
                print("no logs on board")
            return 0
        chosen = [log for log in logs if log.size_bytes and args.log in (None, log.number)]
        if not chosen:
            there = ", ".join(str(log.number) for log in logs) or "none"
            raise UsageError(f"there is no log {'' if args.log is None else args.log} on board; there is {there}")
        file = store.fetch(chosen[-1], args.out, _progress if sys.stderr.isatty() else lambda share: None)
        if args.json:
            print(json.dumps({"file": str(file), **asdict(chosen[-1])}))
        else:
            print(f"{file}  ({chosen[-1].size_bytes:,} bytes, written {chosen[-1].date})")
    return 0


def _trace(args: argparse.Namespace) -> int:
    """Write estimate.jsonl and judge the flight anew, unless its truth is known: then say how good the trace is."""
    from dronecats.judge.distances import sentence
    from dronecats.judge.episode import write_verdict
    from dronecats.report.afterflight.surveyed_target import target_from
    from dronecats.report.afterflight.trace import against_truth, derive
    from foundation.run_folder.layout import EPISODE
    from foundation.run_folder.reading import episode_folder, read
    from foundation.run_folder.writing import as_json

    if args.target_std is not None and not args.target:
        raise UsageError("--target-std goes with --target; add it or leave it out")
    folder = episode_folder(args.run_dir)
    file = derive(folder, target_from(args.target, args.target_std) if args.target else None, args.ulog)
    result: dict[str, Any] = {"file": str(file)}
    if read(folder).true:
        from dronecats.flight.sitl.simulation import load_world, origin

        result |= against_truth(folder, origin(load_world(str(folder / EPISODE))))
        told = (
            f"against the truth: {result['rms_m']:.2f} m rms, {result['max_m']:.2f} m at most,"
            f" {100 * result['within_2_std']:.0f} % of the axes within two standard deviations"
        )
    else:
        verdict = write_verdict(folder)
        distances = verdict.distances or None
        result |= {"outcome": verdict.outcome, "distances": as_json(distances)}
        told = sentence(distances, verdict.delta_m) if distances else "no target was surveyed"
    print(json.dumps(result) if args.json else f"{file}\n{told}")
    return 0


def _table(logs: "list[FlightLog]") -> "ReportTable":
    from dronecats.report.table import numbers, table_of, words

    lines = ((log.number, log.date, f"{log.size_bytes:,}") for log in logs)
    return table_of((numbers("log"), words("date"), numbers("bytes")), lines)


def _progress(share: float) -> None:
    print(f"\r{100 * share:3.0f} %{chr(10) if share >= 1.0 else ''}", end="", file=Drawing(), flush=True)
