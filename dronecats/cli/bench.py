"""Verb `bench`: flies a suite with models and pilots, or resumes a stopped benchmark; exports runs as Parquet."""

import argparse
import json
from contextlib import ExitStack
from pathlib import Path

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import print_next
from dronecats.cli.options import (
    DROP_STALLED,
    MATRIX,
    NO_RETRY,
    PILOTS,
    PLACE,
    SELECTION,
    add,
    add_disturbances,
    add_view,
    with_folder,
)
from dronecats.cli.output import print_note
from foundation.errors import UsageError

EXPORT = "export-parquet"  # as the first argument: export runs as Parquet instead of flying


def add_bench_options(parser: argparse.ArgumentParser) -> None:
    episodes = parser.add_argument_group("episodes")
    episodes.add_argument(
        "episodes",
        nargs="*",
        metavar="ID|FILE",
        help="ids or record files; or a .toml file with all options: docs/bench.md; or export-parquet RUN…",
    )
    add(episodes, (*SELECTION, NO_RETRY))
    add(parser.add_argument_group("pilot"), (*PILOTS, *MATRIX))
    add_disturbances(parser)
    run_group = parser.add_argument_group("run")
    add(run_group, with_folder(PLACE, "runs/bench-SUITE"))
    add_view(run_group)
    add(run_group, [DROP_STALLED])
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    """Fly. Return 0 if everything was flown, 3 if a flight ended in an error or the budget is spent."""
    if args.episodes[:1] == [EXPORT]:
        return _export(args)
    interrupt_on_signals()
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.tables import bench_rows
    from dronecats.cli import bench_spec, campaign

    args = bench_spec.with_file(args)
    campaign.check_engine(args)
    suite = bench_spec.suite(args)
    out = args.out or Path("runs") / f"bench-{suite.identity.name or 'episodes'}"
    shard = bench_spec.shard(args)
    entries = bench_spec.runs(args, suite, out)
    retry = not args.no_retry
    bench = Bench(out, suite, entries, retry=retry, limit=args.limit, shard=shard, report=print_note)
    with ExitStack() as pages:
        result = campaign.fly(bench, args, retry=retry, pages=pages)
        campaign.print_result(result, bench_rows(result.scores, drop_stalled=args.drop_stalled), as_json=args.json)
    flights = [run.batch.folder(episode) for run, episode, _ in bench.stored()]
    if flights and not args.json:
        print_next("bench", out=out, flight=flights[0])
    return campaign.status(result, "bench")


def _export(args: argparse.Namespace) -> int:
    """Write runs as Parquet files, one per table, and print each table's number of rows.

    Prints the names of damaged episodes on standard error.
    """
    from dronecats.report.recorded.run import recorded_runs
    from dronecats.report.results.database import write_tables

    runs = [Path(name) for name in args.episodes[1:]]
    if not runs or args.out is None:
        raise UsageError(f"{EXPORT} needs run folders, or folders of runs, and --out DIR for the files")
    rows, damage = write_tables("parquet", recorded_runs(runs), args.out)
    for episode in damage:
        print_note(f"dronecats bench: {episode} is damaged, so it is only in the table `episodes`")
    if args.json:
        print(json.dumps({"rows": rows, "damaged": damage, "out": str(args.out)}))
    else:
        for table, count in rows.items():
            print(f"{args.out / f'{table}.parquet'}  {count} rows")
    return 0
