"""`dronecats flightlog`: the flight logs on board of an autopilot, listed and fetched."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("flightlog")
    what = parser.add_subparsers(dest="what", metavar="list|fetch", required=True)
    listing = what.add_parser("list", help="say which logs there are")
    fetching = what.add_parser("fetch", help="download one")
    for each in (listing, fetching):
        each.add_argument("--connect", required=True, metavar="URL", help="udpin://0.0.0.0:14550, serial://…")
        each.add_argument("--json", action="store_true", help="print one JSON object")
    fetching.add_argument("--out", type=Path, default=Path(), metavar="DIR", help="where to (default: here)")
    fetching.add_argument("--log", type=int, metavar="N", help="its number on board (default: the newest)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List, or fetch one log and print its file."""
    from dronecats.border.errors import UsageError
    from hil.flight_logs import log_store

    with log_store(args.connect) as store:
        logs = store.entries()
        if args.what == "list":
            print(json.dumps({"logs": [asdict(log) for log in logs]}) if args.json else _table(logs))
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


def _table(logs: list) -> str:  # type: ignore[type-arg]
    lines = [f"{log.number:6}  {log.date:24}  {log.size_bytes:12,} bytes" for log in logs]
    return "\n".join(lines) or "no logs on board"


def _progress(share: float) -> None:
    print(f"\r{100 * share:3.0f} %{chr(10) if share >= 1.0 else ''}", end="", file=sys.stderr, flush=True)
