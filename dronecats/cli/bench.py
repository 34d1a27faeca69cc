"""`dronecats bench`: fly a suite with models and pilots, several flights of each, and go on where it stopped."""

import argparse
import json
import sys
from contextlib import ExitStack
from pathlib import Path

from dronecats.cli import signals, sitting
from dronecats.cli.bench_spec import DROP_STALLED, MATRIX, NO_RETRY
from dronecats.cli.options import PART, PILOTS, PLACE, add, add_disturbances, with_folder
from dronecats.cli.page_options import add_view

EXPORT = "export-parquet"  # in the place of episodes: runs as Parquet files, one a table of docs/query.md


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("bench")
    what = parser.add_argument_group("what is flown")
    what.add_argument(
        "episodes",
        nargs="*",
        metavar="ID|FILE",
        help="these; a .toml file that says all of it (docs/bench.md); or export-parquet RUN…",
    )
    add(what, (*PART, NO_RETRY))
    add(parser.add_argument_group("who flies"), (*PILOTS, *MATRIX))
    add_disturbances(parser)
    where = parser.add_argument_group("run")
    add(where, with_folder(PLACE, "runs/bench-SUITE"))
    add_view(where)
    add(where, [DROP_STALLED])
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly; status 0 when everything was flown, 3 when something broke or the budget is spent."""
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.tables import bench_rows
    from dronecats.cli import bench_spec

    if args.episodes[:1] == [EXPORT]:
        return _export(args)
    signals.as_interrupts()
    args = bench_spec.with_file(args)
    sitting.check_address(args)
    chosen = bench_spec.suite(args)
    out = args.out or Path("runs") / f"bench-{chosen.name or 'episodes'}"
    shard = bench_spec.shard(args)
    entries = bench_spec.runs(args, chosen, out)
    retry = not args.no_retry
    bench = Bench(out, chosen, entries, retry=retry, limit=args.limit, shard=shard, say=sitting.say_line)
    with ExitStack() as beside:
        sat = sitting.sit(bench, args, retry=retry, beside=beside)
        sitting.say(sat, bench_rows(sat.scores, drop_stalled=args.drop_stalled), as_json=args.json)
    return sitting.status(sat, "bench")


def _export(args: argparse.Namespace) -> int:
    """Write the files and print how many rows each has; status 0, damaged episodes named on standard error.

    The runs are what stands behind the action among the verb's episodes. Raises UsageError.
    """
    from dronecats.report.recorded.run import recorded_runs
    from dronecats.report.results.database import write_tables
    from foundation.errors import UsageError

    runs = [Path(each) for each in args.episodes[1:]]
    if not runs or args.out is None:
        raise UsageError(f"{EXPORT} wants run folders, or folders of runs, and --out DIR for the files")
    rows, damage = write_tables("parquet", recorded_runs(runs), args.out)
    for said in damage:
        print(f"dronecats bench: left out but for its row in episodes: {said}", file=sys.stderr)
    if args.json:
        print(json.dumps({"rows": rows, "damaged": damage, "out": str(args.out)}))
    else:
        for table, count in rows.items():
            print(f"{args.out / f'{table}.parquet'}  {count} rows")
    return 0
