"""`dronecats bench`: fly a suite with models and pilots, several flights of each, and go on where it stopped."""

import argparse
from contextlib import ExitStack
from pathlib import Path

from dronecats.cli import signals, sitting
from dronecats.cli.campaign_options import add_part, add_pilots, add_place
from dronecats.cli.disturbance_options import add_disturbance_options


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
    add_part(what)
    what.add_argument("--no-retry", action="store_true", help="leave what did not move as it is: docs/bench.md")
    who = parser.add_argument_group("who flies")
    add_pilots(who)
    who.add_argument(
        "--agent", action="extend", nargs="+", metavar="NAME",
        help="paper (default), steady, or MODULE:NAME: docs/extending.md",
    )  # fmt: skip
    who.add_argument(
        "--command", action="extend", nargs="+", metavar="HOW", help="of fleets: flat (default), hierarchical, solo"
    )
    who.add_argument(
        "--latency",
        action="extend",
        nargs="+",
        metavar="POLICY",
        help="what a reply takes (fixed:0.5): docs/latency.md",
    )
    who.add_argument(
        "--rate", action="extend", nargs="+", metavar="HZ", help="pin the control rate: 1/HZ s for a reply"
    )
    add_disturbance_options(parser)
    where = parser.add_argument_group("run")
    add_place(where, "runs/bench-SUITE")
    where.add_argument("--drop-stalled", action="store_true", help="leave unscored what the host has delayed")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly; status 0 when everything was flown, 3 when something broke or the budget is spent."""
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.summary import table
    from dronecats.cli import bench_export, bench_spec

    if args.episodes[:1] == [bench_export.ACTION]:
        return bench_export.run(args)
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
        sitting.say(sat, table(sat.scores, drop_stalled=args.drop_stalled), as_json=args.json)
    return sitting.status(sat, "bench")
