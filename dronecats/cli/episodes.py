"""Verb `episodes`: lists, shows and checks episode records."""

import argparse
import dataclasses
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.episode_authoring import add_new_options, add_optics_options, add_probe_options, add_sheet_options
from dronecats.cli.episodes_audit import add_audit_options
from dronecats.cli.next_commands import print_next
from dronecats.cli.output import Drawing, show
from dronecats.report.table import ReportTable, in_blocks, numbers, row, table_of, words
from episodes.authoring.check.finding import RuleFinding
from foundation.errors import UsageError

if TYPE_CHECKING:
    from episodes.authoring.check.rules import Report
    from episodes.records.record import EpisodeRecord


def add_episodes_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="print one line per episode")
    listing.add_argument("--suite", default="all", help="one-drone, commanding, quick, all (default) or v1")
    listing.add_argument("--json", action="store_true", help="print one JSON object")
    listing.set_defaults(run=_list)
    showing = actions.add_parser("show", help="print one episode: its map, cell, suites, drones, par and instruction")
    showing.add_argument(
        "episode", metavar="ID", help="an episode's id, a record file, or the folder of a flown episode"
    )
    showing.add_argument("--json", action="store_true", help="print one JSON object, with the record")
    showing.add_argument("--picture", type=Path, metavar="FILE", help="write the first frame (.png or .jpg)")
    showing.set_defaults(run=_show)
    checking = actions.add_parser("check", help="check records against the built scene; status 1 if one is rejected")
    checking.add_argument(
        "episodes",
        nargs="*",
        metavar="ID",
        help="ids, record files, or folders of flown episodes (default: all shipped)",
    )
    checking.add_argument("--suite", metavar="NAME", help="one-drone, commanding, quick, all (default) or v1")
    checking.add_argument(
        "--json", action="store_true", help='print {"checked": n, "rejected": {ID: reason}, "suite": [reason]}'
    )
    checking.add_argument("--rules", action="store_true", help="also print the measurement of every rule")
    checking.add_argument("--jobs", type=int, default=0, metavar="N", help="processes (default: one per core)")
    checking.set_defaults(run=_check)
    add_new_options(actions.add_parser("new", help="propose records that pass the checks, from a seed"))
    add_sheet_options(actions.add_parser("sheet", help="draw assets at 6, 12, 24 and 48 m on one sheet"))
    add_optics_options(actions.add_parser("optics", help="draw one place with every lens, sensor and weather option"))
    add_audit_options(
        actions.add_parser("audit", help="fly episodes with a built-in pilot, to check that they can be solved")
    )
    add_probe_options(actions.add_parser("probe", help="draw a sign and a plate at 4 to 16 m, as a model gets them"))


def _list(args: argparse.Namespace) -> int:
    from episodes.records import catalogue

    pars = catalogue.load_par()  # par: number of steps of the oracle pilot
    records = [catalogue.load(episode) for episode in catalogue.suite_ids(args.suite)]
    if args.json:
        summaries = (_summary(r, catalogue.suites_of(r.id), pars.get(r.id)) for r in records)
        rows = [{**summary, "instruction": r.instruction} for summary, r in zip(summaries, records, strict=True)]
        print(json.dumps({"episodes": rows}))
        return 0
    columns = (words("id"), words("map"), words("cell"), numbers("drones"), numbers("par"), words("instruction"))
    show(table_of(columns, ((r.id, r.map, r.cell, len(r.starts), pars.get(r.id), r.instruction) for r in records)))
    return 0


def _summary(record: "EpisodeRecord", suites: Sequence[str], par: int | None) -> dict[str, Any]:
    return {
        "id": record.id,
        "map": record.map,
        "cell": record.cell,
        "suites": list(suites),
        "drones": len(record.starts),
        "par": par,
    }


def _show(args: argparse.Namespace) -> int:
    """Print the episode and, with --picture, write its first frame."""
    from episodes.records import catalogue

    record = catalogue.load(args.episode)
    member, par = (
        (catalogue.suites_of(record.id), catalogue.load_par().get(record.id))
        if catalogue.is_shipped(record)
        else ((), None)
    )
    if args.picture is not None:
        from episodes.authoring.scene_pictures import write_first_frame

        write_first_frame(record, args.picture)
    if args.json:
        summary = {**_summary(record, member, par), "record": json.loads(record.to_json())}
        print(json.dumps(summary, ensure_ascii=False))
        return 0
    show(table_of((words(""), words("")), _lines(record, member, par)))
    if args.picture is not None:
        print(f"written: {args.picture}")
    return 0


def _lines(record: "EpisodeRecord", member: Sequence[str], par: int | None) -> list[tuple[str, str]]:
    target = record.target
    goal = target.native or f"{target.paint} {target.asset}"
    if target.inscription:
        goal += f" '{target.inscription}' among {len(record.candidates) + 1}"
    if target.path:
        goal += f", moving at {target.path.speed_mps:g} m/s"
    seen = "in sight at the start" if record.visible_at_start else "not in sight at the start"
    return [
        ("id", record.id),
        ("map", f"{record.map}, seed {record.map_seed}"),
        ("cell", record.cell),
        ("suites", ", ".join(member) or "none"),
        ("drones", str(len(record.starts))),
        ("par", f"{par} steps" if par else "not flown yet"),
        ("instruction", record.instruction),
        ("target", goal),
        ("start", f"{record.start_distance_m:g} m away, bearing {record.bearing_deg:g}°, {seen}"),
    ]


def _check(args: argparse.Namespace) -> int:
    """Check the records. Return 1 if a record or the suite is rejected, else 0."""
    from episodes.authoring.check.rules import check_all, check_suite
    from episodes.records import catalogue

    if args.jobs < 0:
        raise UsageError("--jobs must be 1 or more processes")
    if args.episodes and args.suite:
        raise UsageError("choose episodes by name or with --suite, not both")
    names = args.episodes or catalogue.suite_ids(args.suite or "all")
    for name in names:
        catalogue.must_exist(name)
    # suite v1 is older than the rules for suites, and breaks them
    of_suite = not args.episodes and args.suite != "v1"
    reports = []
    for report in check_all(names, args.jobs or None, laid_out=of_suite):
        reports.append(report)
        if sys.stderr.isatty():
            print(f"\r{len(reports)} of {len(names)} checked", end="", file=Drawing(), flush=True)
    if sys.stderr.isatty():
        print("\r" + " " * 30 + "\r", end="", file=Drawing())
    order = {name: k for k, name in enumerate(names)}
    reports.sort(key=lambda r: order[r.source])
    count = Counter(r.name for r in reports)
    # if several files have the same id, the output names the files instead
    reports = [r if count[r.name] == 1 else dataclasses.replace(r, name=r.source) for r in reports]
    rejected = {r.name: r.reason for r in reports if r.reason}
    about_suite = list(check_suite([r.layout for r in reports if r.layout is not None])) if of_suite else []
    uneven = [f.sentence for f in about_suite if not f.passed]
    if args.json:
        print(json.dumps({"checked": len(reports), "rejected": rejected, "suite": uneven}, ensure_ascii=False))
    else:
        show(*_tables(reports, about_suite, args.rules))
        print(f"{len(reports)} checked, {len(rejected)} rejected")
        for sentence in uneven:
            print(f"REJECTED  the suite: {sentence}.")
        own_rejected = [report.source for report in reports if report.reason and Path(report.source).is_file()]
        if own_rejected:
            print_next("episodes check", file=own_rejected[0])
    return 1 if rejected or uneven else 0


def _tables(reports: "list[Report]", about_suite: list[RuleFinding], rules: bool) -> list[ReportTable]:
    """Return a table with a row per record; with `rules`, a row per rule of each record and of the suite."""
    verdicts = [(report.name, f"REJECTED  {report.reason}" if report.reason else "ok") for report in reports]
    if not rules:
        return [table_of((words(""), words("")), verdicts)]
    blocks = [(f"{name}: {verdict}", r.findings) for (name, verdict), r in zip(verdicts, reports, strict=True)]
    blocks += [("the suite", tuple(about_suite))] if about_suite else []
    rows = (
        (title, row("ok" if finding.passed else "failed", finding.rule, finding.measured, finding.wanted))
        for title, findings in blocks
        for finding in findings
    )
    columns = (words(""), words("rule"), words("measured"), words("wanted"))
    return [ReportTable(columns=columns, blocks=in_blocks(rows))]
