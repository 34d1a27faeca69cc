"""One sitting of a campaign at the terminal, as `bench` and `study` have it: flown, told, and its exit status."""

import argparse
import json
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import show
from dronecats.cli.page_options import view_of

if TYPE_CHECKING:
    from dronecats.agent.models.ledger import Spent
    from dronecats.bench.benchmark_folder import Bench
    from dronecats.bench.campaign import Ending
    from dronecats.bench.engine import Engine
    from dronecats.bench.progress import CostEstimate
    from dronecats.bench.tables import BenchRow, EpisodeScore
    from foundation.run_folder.results import Result

FILES = 256  # open ones that a sitting needs besides a lock a run


@dataclass(frozen=True, slots=True, kw_only=True)
class Sitting:
    """What a sitting came to."""

    out: Path
    scores: "list[EpisodeScore]"  # of all that was asked for, whenever it was flown
    ending: "Ending"
    episodes: int  # asked for
    done: int
    spent: "Spent | None"  # None: nobody is paid
    broken: "Mapping[tuple[str, str], Result]"  # by run and episode, what broke off


def say_line(line: str) -> None:
    """Say a line on standard error, where nothing of the result goes."""
    print(line, file=sys.stderr, flush=True)


def check_address(args: argparse.Namespace) -> None:
    """Raise UsageError for an address without a cluster, a page that cannot be shown, and a missing package."""
    from foundation import extras
    from foundation.errors import UsageError

    if view_of(args) and args.engine == "ray":
        raise UsageError("--view shows what flies on this machine, and not on a cluster's others; leave it out")

    if args.address and args.engine != "ray":
        raise UsageError("--address goes with --engine ray; add it or leave --address out")
    if args.engine == "ray":
        extras.require("ray")


def allow_locks(runs: int) -> None:
    """Let this process hold a lock for each of so many runs. Raises UsageError where the system does not."""
    from foundation.errors import UsageError

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = runs + FILES
    if hard != resource.RLIM_INFINITY and wanted > hard:
        raise UsageError(f"{runs:,} runs want as many open files, and the system allows {hard:,}; fly fewer at a time")
    if soft != resource.RLIM_INFINITY and wanted > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def sit(bench: "Bench", args: argparse.Namespace, *, retry: bool, beside: ExitStack) -> Sitting:
    """Fly what is left of a folder, saying on standard error how it goes, and close it. Raises DronecatsError.

    A page that is wanted is opened `beside`, and is there until that is closed.
    """
    from dronecats.bench.campaign import Campaign, EndedFlight
    from dronecats.bench.engine import cores
    from dronecats.bench.progress import CostEstimate, Progress
    from dronecats.cli.live import Live
    from dronecats.flight.run.accounts import Spending
    from dronecats.view.live.opening import opened

    broken: dict[tuple[str, str], Result] = {}
    try:
        jobs = args.jobs or cores()
        campaign = Campaign(bench.runs, jobs=jobs, retry=retry)
        progress = Progress(total=sum(len(each.part) for each in bench.runs))
        left = campaign.left
        estimate = CostEstimate(bench.runs, left)
        for each, episode, result in bench.stored():
            if (each.entry.name, episode) not in left:
                progress.stored(result)
                estimate.add(each, result)
        spending, began_s = Spending(bench.out), time.monotonic()
        ending: Ending = "flown"

        def told() -> str:
            return progress.line(time.monotonic() - began_s, spending.spent(), estimate.left_usd())

        def came(each: EndedFlight) -> None:
            name = f"{each.run.entry.name}/{each.result.episode}"
            progress.add(each.result, again=each.again)
            estimate.add(each.run, each.result, again=each.again)
            if each.result.outcome == "error":
                broken[each.run.entry.name, each.result.episode] = each.result
                live.say(f"{name}: {each.result.error}")
            if each.dropped:
                live.say(f"{name}: {each.dropped} more flights of this model are not begun")
            if each.again:
                live.say(f"{name}: it did not move, and is flown once more")
            live.now(told(), progress.done)

        live = Live(progress.total)
        try:
            if left:
                if estimate.flights:
                    live.say(_foreseen(estimate))
                live.now(told(), progress.done)
                beside.enter_context(opened(view_of(args), bench.out, bench.out.name, live.say))
                ending = campaign.fly(_engine(args, bench.out, min(jobs, len(left))), came)
        except KeyboardInterrupt:
            live.close()
            print(f"go on where it stopped with the same command; {bench.out} holds what was flown", file=sys.stderr)
            raise
        finally:
            live.close(told())
            spent = spending.spent()
            spending.close()
        scores = bench.scores(lambda run, episode: broken.get((run.entry.name, run.batch.folder(episode).name)))
    finally:
        bench.close()
    return Sitting(
        out=bench.out, scores=scores, ending=ending, episodes=progress.total, done=progress.done, spent=spent,
        broken=broken,
    )  # fmt: skip


def _foreseen(estimate: "CostEstimate") -> str:
    """Return what the flights of models that are left are going to cost, a sentence."""
    flights = f"{estimate.flights} flight{'' if estimate.flights == 1 else 's'} of models"
    usd = estimate.left_usd()
    if usd is None:
        return f"cost of {flights}: not known, since {estimate.unpriced} has no prices"
    return f"cost of {flights}: about ${usd:.2f} if each flies to its cap; measured anew as flights end"


def _engine(args: argparse.Namespace, out: Path, jobs: int) -> "Engine":
    """Return what flies. Raises UsageError for a cluster that is not there."""
    from dronecats.bench.engine import LocalEngine
    from foundation.errors import UsageError
    from foundation.run_folder.layout import LEDGER

    if args.engine != "ray":
        return LocalEngine(out / "worker.log", jobs)
    if args.cache:
        raise UsageError("--cache is a file of this machine, which the cluster's others do not see; leave it out")
    from dronecats.bench.cluster import ClusterEngine

    return ClusterEngine(jobs, out / LEDGER if args.model else None, args.address)


def say(sat: Sitting, rows: "Sequence[BenchRow]", *, as_json: bool, more: Mapping[str, Any] | None = None) -> None:
    """Print the table and the folder, or with `as_json` one object with these and `more`."""
    from dronecats.bench.tables import bench_table

    if as_json:
        paid = {"tokens": sat.spent.tokens, "usd": round(sat.spent.usd, 6)} if sat.spent else None
        told = {"out": str(sat.out), "ending": sat.ending, "episodes": sat.episodes, "done": sat.done, "spent": paid}
        print(json.dumps({**told, **(more or {}), "rows": [asdict(row) for row in rows]}))
    else:
        show(bench_table(rows))
        print(f"folder: {sat.out}")


def status(sat: Sitting, verb: str) -> int:
    """Return the exit status, and say on standard error why it is not 0."""
    if sat.ending == "budget":
        why = next(each.error for each in sat.broken.values() if each.reason == "budget")
        print(f"dronecats {verb}: {why}; the same command goes on", file=sys.stderr)
        return 3
    if sat.broken:
        count = f"{len(sat.broken)} flight{'s' if len(sat.broken) > 1 else ''}"
        print(f"dronecats {verb}: {count} broke off; the same command flies them again", file=sys.stderr)
        return 3
    return 0
