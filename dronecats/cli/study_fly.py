"""`dronecats study latency`, `jitter` and `run`: the actions that fly, by options or by a file."""

import argparse
import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli import signals, sitting
from dronecats.cli.options import PART, PILOTS, PLACE, Option, add, add_disturbances, level_list, with_folder
from dronecats.cli.page_options import add_view

if TYPE_CHECKING:
    from dronecats.bench.campaign import OpenRun
    from dronecats.cli.study_spec import AskedStudy

AGAIN = Path("again")  # where the run folders of flights that are repeated go
LATENCIES = "0,0.25,0.5,1,2,4"  # s
RATE, CVS = "2", "0,0.25,0.5,1,2"  # Hz; deviation over mean
SECONDS = Option(name="seconds", kind=float, metavar="S", help="length of a flight, vehicle time (300)")


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    latency = actions.add_parser("latency", help="the same flights with one reply time after another")
    latency.add_argument(
        "--values", metavar="S,S,…", default=LATENCIES, help=f"seconds that a reply takes ({LATENCIES})"
    )
    _add_study(latency, "runs/study-latency")
    latency.set_defaults(run=_fly_latency)
    jitter = actions.add_parser("jitter", help="the same flights at one mean rate, which wavers more and more")
    jitter.add_argument("--rate", metavar="HZ", default=RATE, help=f"replies a second, the mean ({RATE})")
    jitter.add_argument("--cv", metavar="X,X,…", default=CVS, help=f"deviation of a reply's time over its mean ({CVS})")
    jitter.add_argument("--rho", metavar="X", help="correlation of one reply's time with the next one's (none)")
    _add_study(jitter, "runs/study-jitter")
    jitter.set_defaults(run=_fly_jitter)
    of_file = actions.add_parser("run", help="what a file says: any factors, by any design")
    of_file.add_argument("file", type=Path, metavar="FILE", help="the study, .toml: docs/studies.md")
    _add_study(of_file, "runs/NAME-OF-THE-FILE")
    of_file.set_defaults(run=_fly_file)


def _add_study(parser: argparse.ArgumentParser, folder: str) -> None:
    """Declare what is flown, who flies it, and where it is kept; `folder` is what --out is unless it is given."""
    what = parser.add_argument_group("what is flown")
    what.add_argument("--episodes", type=level_list, metavar="ID,ID,…", help="these, by id or file")
    what.add_argument("--cells", type=level_list, metavar="CELL,…", help="the suite's episodes (of all) of these cells")
    what.add_argument("--maps", type=level_list, metavar="MAP,…", help="the suite's episodes (of all) on these maps")
    hold = Option(
        name="hold", repeated=True, metavar="FACTOR=LEVEL", help="set this in every flight, too: docs/studies.md"
    )
    add(what, (*PART, SECONDS, hold))
    add(parser.add_argument_group("who flies"), PILOTS)
    add_disturbances(parser)
    where = parser.add_argument_group("run")
    add(where, with_folder(PLACE, folder))
    add_view(where)


def _fly_latency(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_options

    return fly(of_options(args, "latency", {"latency": level_list(args.values)}))


def _fly_jitter(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_options

    held = {"rate": args.rate, **({} if args.rho is None else {"jitter_rho": args.rho})}
    return fly(of_options(args, "jitter", {"jitter_cv": level_list(args.cv)}, held))


def _fly_file(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_file

    return fly(of_file(args))


def fly(asked: "AskedStudy") -> int:
    """Fly what is left of a study; status 0 when all was flown, 3 when something broke or the budget is spent.

    What does not move stays as it is: a second flight on the same seed is the first one, or breaks the pair.
    """
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.tables import bench_rows
    from dronecats.cli import bench_spec
    from dronecats.study import continued, folder

    args, out = asked.args, asked.out
    signals.as_interrupts()
    sitting.check_address(args)
    sitting.allow_locks(len(asked.plan.entries))
    study = continued.joined(out, asked.plan)
    bench = Bench(
        out, asked.suite, asked.plan.entries, retry=False, limit=args.limit,
        shard=bench_spec.shard(args), first=lambda: folder.write(out, study),
        say=sitting.say_line,
    )  # fmt: skip
    with ExitStack() as beside:
        sat = sitting.sit(bench, args, retry=False, beside=beside)
        repeats = {run.entry.name: again(run) for run in bench.runs if run.part}
        if not args.json:
            print("a flight of each run once more, alone and to the byte:")
            for command in repeats.values():
                print(f"  {command}")
        report = shlex.join(["dronecats", "study", "report", str(out)])
        more = {"study": study.name, "again": repeats, "report": report}
        sitting.say(sat, bench_rows(sat.scores), as_json=args.json, more=more)
        if not args.json:
            print(f"report: {report}")
    return sitting.status(sat, "study")


def again(run: "OpenRun") -> str:
    """Return the command that repeats the first flight of a run."""
    folder = run.batch.run
    name = run.batch.folder(run.part[0]).name
    episode = name if run.part[0] == name else str(Path(folder) / name)  # of a record of one's own, the folder has it
    return shlex.join(
        [
            "dronecats",
            "fly",
            "--spec",
            str(folder / "run.json"),
            "--episode",
            episode,
            "--out",
            str(AGAIN / run.entry.name),
        ]
    )
