"""Verb `preflight`: checks whether a connected vehicle is fit to fly. It never arms the vehicle."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.next_commands import print_next
from dronecats.cli.options import SIGN, add, key_of
from dronecats.cli.output import show
from dronecats.report.table import ReportTable, numbers, table_of, words
from foundation.errors import UsageError
from hil.link import transport
from hil.link.link import Link
from hil.preflight.observation import Change, Row, summary

if TYPE_CHECKING:
    from hil.preflight.check import Check

YES = "yes"
MARKS = {True: "pass", False: "FAIL", None: "?"}
GIVES_KEY = (
    "--give-key sends the key unencrypted. Do it over USB, then restart the vehicle. A PX4 also obeys"
    " unsigned messages until"
    " MAV_SIGN_CFG is 1 or 2.\n"
)


def add_preflight_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--connect",
        required=True,
        metavar="URL",
        help="the vehicle: udpin://0.0.0.0:14540, serial:///dev/ttyACM0:57600",
    )
    add(parser, [SIGN])
    parser.add_argument(
        "--give-key", action="store_true", help="send the key of --sign to the vehicle first, after you confirm"
    )
    parser.add_argument("--camera", metavar="URL", help="also check this camera")
    parser.add_argument("--seconds", type=float, default=5.0, metavar="N", help="time to listen (default 5)")
    parser.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR", help="folder of runs (default runs)")
    parser.add_argument("--fix", action="store_true", help="propose parameter changes, and set them after you confirm")
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the checks. Return 1 if a check fails, else 0."""
    from hil.preflight.check import apply_changes, check

    if not 1.0 <= args.seconds <= 600.0:
        raise UsageError(f"--seconds must be 1 to 600, got {args.seconds:g}")
    if args.give_key and not args.sign:
        raise UsageError("--give-key goes with --sign KEYFILE. Add it, or leave --give-key out")
    key = key_of(args.sign)
    link = Link(transport.connect(args.connect), key=b"" if args.give_key else key)
    link.on_notice = lambda line: print(line, file=sys.stderr)
    try:
        link.connect()
        if args.give_key:
            if not _typed_yes(GIVES_KEY, "send the key"):
                return 1
            link.give_key(key)
        result = check(link, seconds=args.seconds, folder=args.out, camera_url=args.camera)
        if not args.json:
            _show(result)
        if args.fix and result.changes and _agreed(result, quiet=args.json):
            result = apply_changes(link, result, result.changes)
            if not args.json:
                print("\nThe parameters are set. The new check:\n")
                _show(result)
    finally:
        link.close()
    failed = any(row.passed is False for row in result.rows)
    if args.json:
        rows, changes = [asdict(row) for row in result.rows], [asdict(change) for change in result.changes]
        print(json.dumps({"passed": not failed, "rows": rows, "changes": changes}))
    else:
        vehicle = [args.connect, *(["--sign", str(args.sign)] if args.sign else [])]
        if result.changes and not args.fix:
            print_next("preflight, fixable", vehicle=vehicle)
        elif args.camera and not failed:
            print_next("preflight", vehicle=vehicle, camera=args.camera)
    return 1 if failed else 0


def _show(result: "Check") -> None:
    show(table(result.rows))
    print(f"\n{summary(result.rows)}", flush=True)


def table(rows: Sequence[Row]) -> ReportTable:
    """Return the checks as a table: mark, name, finding, and remedy."""
    lines = (
        (MARKS[row.passed], row.name, row.why + (f"\n→ {row.fix}" if row.fix and row.passed is not True else ""))
        for row in rows
    )
    return table_of([words("")] * 3, lines)


def proposal(changes: Sequence[Change]) -> ReportTable:
    """Return the parameter changes as a table: name, old value, new value, and reason."""
    lines = ((c.name, f"{c.old:g}", f"→ {c.new:g}", c.reason) for c in changes)
    return table_of((words(""), numbers(""), words(""), words("")), lines)


def _agreed(result: "Check", *, quiet: bool) -> bool:
    """Print the changes, and return whether the user typed `yes`."""
    print("\n--fix would set these parameters of the vehicle:\n", file=sys.stderr)
    show(proposal(result.changes), file=sys.stderr)
    print(file=sys.stderr)
    return _typed_yes("", "set these parameters", quiet=quiet)


def _typed_yes(warning: str, action: str, *, quiet: bool = True) -> bool:
    print(f"{warning}type {YES} to {action}: ", end="", file=sys.stderr, flush=True)
    answer = sys.stdin.readline().strip()
    if answer == YES:
        return True
    print("Nothing was changed." if quiet else "\nNothing was changed.", file=sys.stderr)
    return False
