"""Flies a campaign from the terminal for `bench` and `study`: progress, summary and exit status."""

import argparse
import json
import resource
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.models.ledger import Spent
from dronecats.bench.benchmark_folder import Bench
from dronecats.bench.campaign import Campaign, EndedFlight, Ending
from dronecats.bench.engine import Engine, LocalEngine
from dronecats.bench.progress import CostEstimate, Progress
from dronecats.bench.tables import BenchRow, EpisodeScore, bench_table
from dronecats.cli.options import view_of
from dronecats.cli.output import Live, print_note, show
from dronecats.flight.run.accounts import spent_in
from dronecats.view.live.opening import opened
from foundation import extras
from foundation.errors import UsageError
from foundation.machine import cores
from foundation.run_folder.layout import LEDGER
from foundation.run_folder.results import Result
from foundation.wording import counted

SPARE_FILES = 256  # open files that a campaign needs in addition to a lock per run


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignResult:
    """The result of a campaign: its scores, and the flights that ended in an error."""

    out: Path
    scores: list[EpisodeScore]  # of all requested episodes, flown now or earlier
    ending: Ending
    episodes: int  # number of requested episodes
    done: int  # number of requested episodes that have a result
    spent: Spent | None  # None: no model was paid
    broken: Mapping[tuple[str, str], Result]  # (run, episode) → result of a flight that ended in an error


def check_engine(args: argparse.Namespace) -> None:
    """Raise UsageError for --address without --engine ray, --view with --engine ray, and a missing package."""
    if view_of(args) and args.engine == "ray":
        raise UsageError("--view shows flights of this machine only, not of a cluster. Leave it out")
    if args.address and args.engine != "ray":
        raise UsageError("--address goes with --engine ray. Add it, or leave --address out")
    if args.engine == "ray":
        extras.require("ray")


def allow_locks(runs: int) -> None:
    """Increase the limit of open files for the locks of `runs` runs. Raises UsageError if the system forbids this."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = runs + SPARE_FILES
    if hard != resource.RLIM_INFINITY and wanted > hard:
        raise UsageError(
            f"{runs:,} runs need as many open files, but the system allows {hard:,}. Fly fewer runs at a time, or"
            " raise ulimit -n"
        )
    if soft != resource.RLIM_INFINITY and wanted > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def fly(bench: Bench, args: argparse.Namespace, *, retry: bool, pages: ExitStack) -> CampaignResult:
    """Fly the missing flights of `bench`, print progress on standard error, and close `bench`.

    The page of --view stays open until `pages` is closed. Raises DronecatsError.
    """
    broken: dict[tuple[str, str], Result] = {}
    try:
        jobs = args.jobs or cores()
        campaign = Campaign(bench.runs, jobs=jobs, retry=retry)
        progress = Progress(total=sum(len(run.part) for run in bench.runs))
        left = campaign.left
        estimate = CostEstimate(bench.runs, left)
        for run, episode, result in bench.stored():
            if (run.entry.name, episode) not in left:
                progress.stored(result)
                estimate.add(run, result)
        began_s = time.monotonic()
        ending: Ending = "flown"

        def state() -> str:
            return progress.line(time.monotonic() - began_s, spent_in(bench.out), estimate.left_usd())

        def ended(flight: EndedFlight) -> None:
            name = f"{flight.run.entry.name}/{flight.result.episode}"
            progress.add(flight.result, again=flight.again)
            estimate.add(flight.run, flight.result, again=flight.again)
            if flight.result.outcome == "error":
                broken[flight.run.entry.name, flight.result.episode] = flight.result
                live.say(f"{name}: {flight.result.error}")
            if flight.dropped:
                live.say(f"{name}: {flight.dropped} more flights of this model are cancelled")
            if flight.again:
                live.say(f"{name}: the drone did not move; the flight is retried once")
            live.now(state(), progress.done)

        live = Live(progress.total)
        try:
            if left:
                if estimate.flights:
                    live.say(_cost_line(estimate))
                live.now(state(), progress.done)
                pages.enter_context(opened(view_of(args), bench.out, bench.out.name, live.say))
                paid = any(run.entry.flight.accounts.ledger for run in bench.runs)
                ending = campaign.fly(_engine(args, bench.out, min(jobs, len(left)), paid=paid), ended)
        except KeyboardInterrupt:
            live.close()
            print_note(f"interrupted: {bench.out} has the finished flights. The same command resumes")
            raise
        finally:
            live.close(state())
            spent = spent_in(bench.out)
        scores = bench.scores(lambda run, episode: broken.get((run.entry.name, run.batch.folder(episode).name)))
    finally:
        bench.close()
    return CampaignResult(
        out=bench.out, scores=scores, ending=ending, episodes=progress.total, done=progress.done, spent=spent,
        broken=broken,
    )  # fmt: skip


def _cost_line(estimate: CostEstimate) -> str:
    flights = f"{counted(estimate.flights, 'flight')} of models"
    usd = estimate.left_usd()
    if usd is None:
        return f"cost of {flights}: unknown, because {estimate.unpriced} has no prices"
    return (
        f"cost of {flights}: about ${usd:.2f} if each flies to its time limit. The estimate is updated as flights end"
    )


def _engine(args: argparse.Namespace, out: Path, jobs: int, *, paid: bool) -> Engine:
    """Return the engine that runs the flights; `paid`: whether some flight uses a paid model.

    Raises UsageError for --cache with a cluster, and if the cluster does not answer.
    """
    if args.engine != "ray":
        return LocalEngine(out / "worker.log", jobs)
    if args.cache:
        raise UsageError("--cache is a file of this machine, and a cluster cannot read it. Leave it out")
    from dronecats.bench.cluster import ClusterEngine

    return ClusterEngine(jobs, out / LEDGER if paid else None, args.address)


def print_result(
    result: CampaignResult, rows: Sequence[BenchRow], *, as_json: bool, more: Mapping[str, Any] | None = None
) -> None:
    """Print the table and the folder; with `as_json`, print one object with the result and `more`."""
    if as_json:
        spent = result.spent and {"tokens": result.spent.tokens, "usd": round(result.spent.usd, 6)}
        counts = {"ending": result.ending, "episodes": result.episodes, "done": result.done, "spent": spent}
        rows_as_json = [asdict(row) for row in rows]
        print(json.dumps({"out": str(result.out), **counts, **(more or {}), "rows": rows_as_json}))
    else:
        show(bench_table(rows))
        print(f"folder: {result.out}")


def status(result: CampaignResult, verb: str) -> int:
    """Return the exit status. If it is not 0, print the reason on standard error."""
    if result.ending == "budget":
        spent = (flight.error for flight in result.broken.values() if flight.reason == "budget")
        # no flight has this error if the flight that spent the rest of the budget succeeded: use the default
        reason = next(spent, "the budget is spent")
        print_note(f"dronecats {verb}: {reason}. The same command resumes")
        return 3
    if result.broken:
        print_note(
            f"dronecats {verb}: {counted(len(result.broken), 'flight')} ended in an error. The same command retries"
        )
        return 3
    return 0
