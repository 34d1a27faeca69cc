"""A study flown, and said: shared by the actions of `dronecats study` that fly."""

import shlex
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli import bench_spec, signals, sitting

if TYPE_CHECKING:
    from dronecats.bench.campaign import OpenRun
    from dronecats.cli.study_spec import AskedStudy

AGAIN = Path("again")  # where the run folders of flights that are repeated go


def fly(asked: "AskedStudy") -> int:
    """Fly what is left of a study; status 0 when all was flown, 3 when something broke or the budget is spent.

    What does not move stays as it is: a second flight on the same seed is the first one, or breaks the pair.
    """
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.summary import table
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
        sitting.say(sat, table(sat.scores), as_json=args.json, more=more)
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
