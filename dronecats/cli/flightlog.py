"""Verb `flightlog`: fetches logs from an autopilot, and derives the path of a flight from its logs."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import Drawing, show
from dronecats.judge.diagnostics import distances_sentence
from dronecats.report.table import ReportTable, numbers, table_of, words
from foundation.errors import UsageError
from foundation.run_folder.layout import EPISODE
from foundation.run_folder.reading import episode_folder, episodes, read
from foundation.run_folder.writing import as_json
from hil.link.flight_logs import FlightLog, log_store


def add_flightlog_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="list the logs on board")
    fetching = actions.add_parser("fetch", help="download one log")
    tracing = actions.add_parser(
        "trace", help="estimate the path of a real flight from its log, and judge the flight by it"
    )
    for action in (listing, fetching):
        action.add_argument("--connect", required=True, metavar="URL", help="udpin://0.0.0.0:14550, serial://…")
        action.add_argument("--json", action="store_true", help="print one JSON object")
    fetching.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="folder for the log (default: here)")
    fetching.add_argument("--log", type=int, metavar="N", help="number of the log on board (default: the newest)")
    tracing.add_argument(
        "run_dir", type=Path, metavar="RUN[/EPISODE]", help="a run folder of one episode, or the folder of the episode"
    )
    tracing.add_argument("--ulog", type=Path, metavar="FILE", help="the autopilot's own log (default: flight.tlog)")
    tracing.add_argument(
        "--target", metavar="LAT,LON[,ALT]", help="surveyed position of the target's centre; ALT above mean sea level"
    )
    tracing.add_argument(
        "--target-std",
        type=float,
        metavar="M",
        help="its standard deviation per axis in metres (default 3, a handheld GPS)",
    )
    tracing.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List the logs, fetch a log, or derive a path."""
    return _trace(args) if args.action == "trace" else _on_board(args)


def _on_board(args: argparse.Namespace) -> int:
    with log_store(args.connect) as store:
        logs = store.entries()
        if args.action == "list":
            if args.json:
                print(json.dumps({"logs": [asdict(log) for log in logs]}))
            elif logs:
                show(_table(logs))
            else:
                print("The autopilot has no logs on board.")
            return 0
        chosen = [log for log in logs if log.size_bytes and args.log in (None, log.number)]
        if not chosen:
            there = ", ".join(str(log.number) for log in logs) or "none"
            name = "a log" if args.log is None else f"log {args.log}"
            raise UsageError(f"{name} is not on board. Logs on board: {there}")
        file = store.fetch(chosen[-1], args.out, _progress if sys.stderr.isatty() else lambda share: None)
        if args.json:
            print(json.dumps({"file": str(file), **asdict(chosen[-1])}))
        else:
            print(f"{file}  ({chosen[-1].size_bytes:,} bytes, written {chosen[-1].date})")
            if len(episodes(args.out)) == 1:  # --out is a run of one flight, so the log is probably of this flight
                print_next("flightlog fetch", run=args.out, log=file)
    return 0


def _trace(args: argparse.Namespace) -> int:
    """Write the estimated path to estimate.jsonl, and judge the flight by this path.

    If truth.jsonl has true poses, print the error of the estimated path instead of a judgement.
    """
    from dronecats.judge.episode import write_verdict
    from dronecats.report.afterflight import against_truth, derive, target_from

    if args.target_std is not None and not args.target:
        raise UsageError("--target-std goes with --target. Add it, or leave --target-std out")
    folder = episode_folder(args.run_dir)
    file = derive(folder, target_from(args.target, args.target_std) if args.target else None, args.ulog)
    result: dict[str, Any] = {"file": str(file)}
    if read(folder).true:
        from dronecats.flight.sitl.episode_world import load_world, origin

        result |= against_truth(folder, origin(load_world(str(folder / EPISODE))))
        summary = (
            f"error against the truth: {result['rms_m']:.2f} m rms, {result['max_m']:.2f} m at most;"
            f" {100 * result['within_2_std']:.0f} % of the values within two standard deviations"
        )
    else:
        verdict = write_verdict(folder)
        distances = verdict.distances or None
        result |= {"outcome": verdict.outcome, "distances": as_json(distances)}
        summary = (
            distances_sentence(distances, verdict.delta_m)
            if distances
            else "The distance is unknown, because no target was surveyed. To add it: --target LAT,LON,ALT"
        )
    if args.json:
        print(json.dumps(result))
    else:
        print(f"{file}\n{summary}")
        print_next("flightlog trace", run=args.run_dir)
    return 0


def _table(logs: list[FlightLog]) -> ReportTable:
    lines = ((log.number, log.date, f"{log.size_bytes:,}") for log in logs)
    return table_of((numbers("log"), words("date"), numbers("bytes")), lines)


def _progress(share: float) -> None:
    print(f"\r{100 * share:3.0f} %{chr(10) if share >= 1.0 else ''}", end="", file=Drawing(), flush=True)
