"""Verb `study`: flies a study of the effect of disturbances, and writes its report."""

import argparse
import json
import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.next_commands import next_commands, print_next
from dronecats.cli.options import (
    PILOTS,
    PLACE,
    SELECTION,
    Option,
    add,
    add_disturbances,
    add_exclusions,
    add_view,
    level_list,
    with_folder,
)
from dronecats.cli.output import print_note, print_wrapped
from dronecats.cli.study_load import add_load_options
from dronecats.cli.study_loop import add_loop_options
from dronecats.cli.study_rate import add_rate_options
from foundation.extras import not_installed
from foundation.files import check_folder

if TYPE_CHECKING:
    from dronecats.bench.campaign import OpenRun
    from dronecats.cli.study_spec import StudyRequest

REPEATED = Path("again")  # folder for the run folders of repeated flights
LATENCIES = "0,0.25,0.5,1,2,4"  # s, default of --values
RATE, CVS = "2", "0,0.25,0.5,1,2"  # defaults of --rate (Hz) and --cv (standard deviation / mean)
SECONDS = Option(name="seconds", kind=float, metavar="S", help="length of a flight in vehicle time (default 300)")
HOLD = Option(name="hold", repeated=True, metavar="FACTOR=LEVEL", help="set this in every flight: docs/studies.md")


def add_study_options(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    latency = actions.add_parser("latency", help="repeat flights with several reply times")
    latency.add_argument(
        "--values", metavar="S,S,…", default=LATENCIES, help=f"seconds that a reply takes (default {LATENCIES})"
    )
    _add_flying_options(latency, "runs/study-latency")
    latency.set_defaults(run=_fly_latency)
    jitter = actions.add_parser("jitter", help="repeat flights with reply times that vary more and more")
    jitter.add_argument("--rate", metavar="HZ", default=RATE, help=f"mean replies a second (default {RATE})")
    jitter.add_argument(
        "--cv", metavar="X,X,…", default=CVS, help=f"standard deviation over mean of the reply times (default {CVS})"
    )
    jitter.add_argument("--rho", metavar="X", help="correlation of a reply time with the next one (default 0)")
    _add_flying_options(jitter, "runs/study-jitter")
    jitter.set_defaults(run=_fly_jitter)
    of_file = actions.add_parser("run", help="fly the study that a file describes, with any factors and design")
    of_file.add_argument("file", type=Path, metavar="FILE", help="the study, .toml: docs/studies.md")
    _add_flying_options(of_file, "runs/NAME-OF-THE-FILE")
    of_file.set_defaults(run=_fly_file)
    add_rate_options(
        actions.add_parser("rate", help="measure the delays of your own camera, model and link; moves nothing")
    )
    report = actions.add_parser("report", help="write the report of a study: page, figures, tables and data")
    report.add_argument("study", type=Path, metavar="DIR", help="folder of a study")
    report.add_argument("--out", type=Path, metavar="DIR", help="folder of the report (default DIR/report)")
    add_exclusions(report, "flights")
    report.add_argument("--json", action="store_true", help="print the tables as one JSON object")
    report.set_defaults(run=_report)
    add_loop_options(
        actions.add_parser("loop", help="find how much delay and setpoint loss the control loops tolerate")
    )
    add_load_options(actions.add_parser("load", help="repeat flights on a busy computer, in lockstep and in real time"))


def _add_flying_options(parser: argparse.ArgumentParser, folder: str) -> None:
    """Declare the options for episodes, pilots, disturbances and run of a study; `folder` is the default of --out."""
    episodes = parser.add_argument_group("episodes")
    episodes.add_argument("--episodes", type=level_list, metavar="ID,ID,…", help="these episodes, by id or file")
    episodes.add_argument("--cells", type=level_list, metavar="CELL,…", help="these cells of the suite (default all)")
    episodes.add_argument("--maps", type=level_list, metavar="MAP,…", help="these maps of the suite (default all)")
    add(episodes, (*SELECTION, SECONDS, HOLD))
    add(parser.add_argument_group("pilot"), PILOTS)
    add_disturbances(parser)
    run_group = parser.add_argument_group("run")
    add(run_group, with_folder(PLACE, folder))
    add_view(run_group)


def _fly_latency(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_options

    return _fly(of_options(args, "latency", {"latency": level_list(args.values)}))


def _fly_jitter(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_options

    held = {"rate": args.rate, **({} if args.rho is None else {"jitter_rho": args.rho})}
    return _fly(of_options(args, "jitter", {"jitter_cv": level_list(args.cv)}, held))


def _fly_file(args: argparse.Namespace) -> int:
    from dronecats.cli.study_spec import of_file

    return _fly(of_file(args))


def _fly(request: "StudyRequest") -> int:
    """Fly the missing flights of a study. Return 0 if all were flown, 3 after an error or if the budget is spent.

    A flight in which the drone did not move is not retried. In lockstep a retry with the same seed would be identical.
    With another seed it would not match the flights that it is compared with.
    """
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.tables import bench_rows
    from dronecats.cli import bench_spec, campaign
    from dronecats.study import folder

    args, out = request.args, request.out
    interrupt_on_signals()
    campaign.check_engine(args)
    campaign.allow_locks(len(request.plan.entries))
    study = folder.merge_earlier_runs(out, request.plan)
    bench = Bench(
        out, request.suite, request.plan.entries, retry=False, limit=args.limit,
        shard=bench_spec.shard(args), first=lambda: folder.write(out, study),
        report=print_note,
    )  # fmt: skip
    with ExitStack() as pages:
        result = campaign.fly(bench, args, retry=False, pages=pages)
        repeats = {run.entry.name: _repeat_command(run) for run in bench.runs if run.part}
        if not args.json:
            exact = all(run.entry.flight.repeats_exactly for run in bench.runs)
            print(f"Commands that repeat one flight of each run{', with the same bytes' if exact else ''}:")
            for command in repeats.values():
                print(f"  {command}")
        more = {"study": study.name, "again": repeats, "report": next_commands("study", out=out)[0]}
        campaign.print_result(result, bench_rows(result.scores), as_json=args.json, more=more)
        if not args.json:
            print_next("study", out=out)
    return campaign.status(result, "study")


def _repeat_command(run: "OpenRun") -> str:
    """Return the command that repeats the first flight of a run."""
    folder = run.batch.run
    name = run.batch.folder(run.part[0]).name
    # an episode that is not shipped is named by its folder in the run
    episode = name if run.part[0] == name else str(Path(folder) / name)
    words = ["--spec", str(folder / "run.json"), "--episode", episode, "--out", str(REPEATED / run.entry.name)]
    return shlex.join(["dronecats", "fly", *words])


def _report(args: argparse.Namespace) -> int:
    """Write the report. Return 0."""
    from dronecats.report.results.collection import parse_exclusion
    from dronecats.study.analysis.loading import load_results
    from dronecats.study.report.report_folder import as_json, write

    out = args.out or args.study / "report"
    check_folder(out)
    command = ["dronecats", "study", "report", str(args.study), *(["--out", str(args.out)] if args.out else [])]
    command += [word for text in args.exclude_above for word in ("--exclude-above", text)]
    exclusions = [parse_exclusion(text) for text in args.exclude_above]
    report = write(load_results(args.study, exclusions=exclusions), shlex.join(command), out)
    if args.json:
        print(json.dumps(as_json(report)))
        return 0
    print_wrapped(*report.content.opening, *report.content.summary)
    print(f"page: {report.page}, report: {report.markdown}")
    if report.parquet is None:
        print(f"no Parquet was written: {not_installed('duckdb')}")
    else:
        print_next("study report", study=args.study)
    return 0
