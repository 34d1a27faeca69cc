"""`dronecats episodes check`: every rule on every record, measured against the built scene, and those on a suite."""

import argparse
import dataclasses
import json
import sys
from collections import Counter
from typing import TYPE_CHECKING

from dronecats.cli.output import Drawing, show

if TYPE_CHECKING:
    from dronecats.report.table import ReportTable
    from episodes.authoring.check.finding import RuleFinding
    from episodes.authoring.check.rules import Report


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("check", help="check records against the built scene; exit 1 when one is rejected")
    parser.add_argument("episodes", nargs="*", metavar="ID", help="ids, record files or folders (default: all shipped)")
    parser.add_argument("--suite", metavar="NAME", help="one-drone, commanding, quick, all (default) or v1")
    parser.add_argument(
        "--json", action="store_true", help='print {"checked": n, "rejected": {ID: reason}, "suite": [reason]}'
    )
    parser.add_argument("--rules", action="store_true", help="print what every rule measured, too")
    parser.add_argument("--jobs", type=int, default=0, metavar="N", help="processes (default: one per core)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check the records and return 1 when any is rejected."""
    from episodes.authoring.check.rules import check_all
    from episodes.records import catalogue, suites
    from foundation.errors import UsageError

    if args.jobs < 0:
        raise UsageError("--jobs wants a number of processes, 1 or more.")
    if args.episodes and args.suite:
        raise UsageError("choose one: the episodes by name, or --suite")
    asked = args.episodes or suites.ids(args.suite or "all")
    for one in asked:
        catalogue.must_exist(one)
    # version 1 was drawn before there were rules about the spread, and breaks them: that is why there is a version 2
    of_suite = not args.episodes and args.suite != "v1"
    reports = []
    for report in check_all(asked, args.jobs or None, laid_out=of_suite):
        reports.append(report)
        if sys.stderr.isatty():
            print(f"\r{len(reports)} of {len(asked)} checked", end="", file=Drawing(), flush=True)
    if sys.stderr.isatty():
        print("\r" + " " * 30 + "\r", end="", file=Drawing())
    place = {one: k for k, one in enumerate(asked)}
    reports.sort(key=lambda r: place[r.asked])
    names = Counter(r.name for r in reports)
    reports = [r if names[r.name] == 1 else dataclasses.replace(r, name=r.asked) for r in reports]  # copies of one id
    rejected = {r.name: r.reason for r in reports if r.reason}
    about_suite = _about_suite(reports) if of_suite else []
    uneven = [f.sentence for f in about_suite if not f.passed]
    if args.json:
        print(json.dumps({"checked": len(reports), "rejected": rejected, "suite": uneven}, ensure_ascii=False))
    else:
        show(*_tables(reports, about_suite, args.rules))
        print(f"{len(reports)} checked, {len(rejected)} rejected")
        for sentence in uneven:
            print(f"REJECTED  the suite: {sentence}.")
    return 1 if rejected or uneven else 0


def _about_suite(reports: "list[Report]") -> "list[RuleFinding]":
    from episodes.authoring.check import spread

    return list(spread.rules([report.layout for report in reports if report.layout is not None]))


def _tables(reports: "list[Report]", about_suite: "list[RuleFinding]", rules: bool) -> "list[ReportTable]":
    """Return one row per record; where they are asked for, the rules of each record and of the suite instead."""
    from dronecats.report.table import ReportTable, in_blocks, row, table_of, words

    verdicts = [(each.name, f"REJECTED  {each.reason}" if each.reason else "ok") for each in reports]
    if not rules:
        return [table_of((words(""), words("")), verdicts)]
    found = [(f"{name}: {verdict}", each.findings) for (name, verdict), each in zip(verdicts, reports, strict=True)]
    found += [("the suite", tuple(about_suite))] if about_suite else []
    rows = (
        (title, row("ok" if finding.passed else "RED", finding.rule, finding.measured, finding.wanted))
        for title, findings in found
        for finding in findings
    )
    columns = (words(""), words("rule"), words("measured"), words("wanted"))
    return [ReportTable(columns=columns, blocks=in_blocks(rows))]
