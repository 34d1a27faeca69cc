"""Verb `report`: makes the paper's tables and figures from runs, and a page to browse the runs."""

import argparse
import json
import shlex
from pathlib import Path

from dronecats.cli.next_commands import print_next
from dronecats.cli.options import add_exclusions
from dronecats.cli.output import show
from dronecats.report.writers import as_json
from foundation.errors import UsageError
from foundation.files import check_folder
from foundation.protocol import RADIUS_M


def add_report_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folders, or folders that hold runs")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the report")
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument("--pool-anyway", action="store_true", help="count runs with different settings together")
    parser.add_argument("--drop-stalled", action="store_true", help="leave out episodes that the host delayed")
    add_exclusions(parser, "episodes")
    parser.add_argument(
        "--metric", type=Path, action="append", default=[], metavar="FILE.py", help="add a file of your own metrics"
    )
    parser.add_argument("--no-page", action="store_true", help="write no browser page, and remove an earlier one")
    parser.add_argument("--embed", action="store_true", help="embed the pictures in the page")
    parser.add_argument("--json", action="store_true", help="print the tables as one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the report. Return 0."""
    from dronecats.judge.episode import check_radius
    from dronecats.judge.metrics.judging import METRICS, own_metrics
    from dronecats.report.figures import draw
    from dronecats.report.page.index import remove_page, write_page
    from dronecats.report.report_folder import opening, report_data, tables, write
    from dronecats.report.results.collection import collect, exclude, parse_exclusion, without_stalled

    check_radius(args.delta)
    if args.embed and args.no_page:
        raise UsageError("--embed goes with the page. Leave --no-page out")
    check_folder(args.out)
    exclusions = [parse_exclusion(text) for text in args.exclude_above]
    own = tuple(metric for file in args.metric for metric in own_metrics(file))
    collection = collect(args.runs, args.delta, (*METRICS.values(), *own))
    if args.drop_stalled:
        collection = without_stalled(collection)
    collection = exclude(collection, exclusions)
    data = report_data(collection, _command(args), delta_m=args.delta, pool_anyway=args.pool_anyway)
    made = tables(data, own)
    written = write(made, draw(data, made, args.out / "figures"), opening(data, args.delta, exclusions), args.out)
    page = None
    if args.no_page:
        remove_page(args.out)
    else:
        page = write_page(collection, made, args.out, embed=args.embed)
    if args.json:
        print(json.dumps({"report": str(written), "page": page and str(page), "tables": as_json(made)}))
    else:
        show(*made[:1])
        print(f"\nreport: {written}" + (f", page: {page}" if page else ""))
        print_next("report", runs=args.runs)
    return 0


def _command(args: argparse.Namespace) -> str:
    """Return the command line that makes these tables again."""
    command = ["dronecats", "report", *(str(path) for path in args.runs)]
    command += [] if args.delta == RADIUS_M else ["--delta", f"{args.delta:g}"]
    command += ["--pool-anyway"] * args.pool_anyway + ["--drop-stalled"] * args.drop_stalled
    command += [word for text in args.exclude_above for word in ("--exclude-above", text)]
    command += [word for path in args.metric for word in ("--metric", str(path))]
    return shlex.join([*command, "--out", str(args.out)])
