"""`dronecats episodes check`: every rule on every record, measured against the built scene."""

import argparse
import dataclasses
import json
import sys
from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from episodes.check.many import Report


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("check", help="check records against the built scene; exit 1 when one is rejected")
    parser.add_argument("episodes", nargs="*", metavar="ID", help="ids, record files or folders (default: all shipped)")
    parser.add_argument("--json", action="store_true", help='print {"checked": n, "rejected": {ID: reason}}')
    parser.add_argument("--rules", action="store_true", help="print what every rule measured, too")
    parser.add_argument("--jobs", type=int, default=0, metavar="N", help="processes (default: one per core)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check the records and return 1 when any is rejected."""
    from dronecats.border.errors import UsageError
    from episodes import catalogue
    from episodes.check.many import check_all

    if args.jobs < 0:
        raise UsageError("--jobs wants a number of processes, 1 or more.")
    asked = args.episodes or catalogue.ids()
    for one in asked:
        catalogue.must_exist(one)
    reports = []
    for report in check_all(asked, args.jobs or None):
        reports.append(report)
        if sys.stderr.isatty():
            print(f"\r{len(reports)} of {len(asked)} checked", end="", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        print("\r" + " " * 30 + "\r", end="", file=sys.stderr)
    place = {one: k for k, one in enumerate(asked)}
    reports.sort(key=lambda r: place[r.asked])
    names = Counter(r.name for r in reports)
    reports = [r if names[r.name] == 1 else dataclasses.replace(r, name=r.asked) for r in reports]  # copies of one id
    rejected = {r.name: r.reason for r in reports if r.reason}
    if args.json:
        print(json.dumps({"checked": len(reports), "rejected": rejected}, ensure_ascii=False))
    else:
        _table(reports, args.rules)
    return 1 if rejected else 0


def _table(reports: "list[Report]", rules: bool) -> None:
    """Print one line per record, and its rules where they are asked for."""
    for report in reports:
        print(f"{report.name:32} {'REJECTED  ' + report.reason if report.reason else 'ok'}")
        for found in report.findings if rules else ():
            print(f"    {'ok ' if found.passed else 'RED'} {found.rule}: {found.measured} (wanted {found.wanted})")
    rejected = sum(report.reason is not None for report in reports)
    print(f"{len(reports)} checked, {rejected} rejected")
