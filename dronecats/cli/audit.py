"""`dronecats audit RUN…`: what other rules would make of the same flights, and what `think` and mending bought."""

import argparse
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.output import show
from foundation.protocol import CAP_S, RADIUS_M
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.judge.metrics.audit import Audit
    from dronecats.judge.metrics.deliberation import Followed


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("audit")
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="a run folder, one episode of it, or a folder of runs"
    )
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument("--cap", type=float, default=CAP_S, help="seconds after which nothing counts (default 300)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the audit of all episodes together."""
    from dronecats.judge.metrics.audit import audit, audited_episode
    from dronecats.judge.metrics.judging import Judging, of_each
    from dronecats.report.recorded.run import recorded_runs

    Judging(delta_m=args.delta, cap_s=args.cap).check()
    folders = [folder for each in recorded_runs(args.runs) for folder in each.episodes]
    told = audit(of_each(partial(audited_episode, delta_m=args.delta, cap_s=args.cap), folders))
    if args.json:
        print(json.dumps(asdict(told)))
    else:
        _print(told)
    return 0


def _print(told: "Audit") -> None:
    from dronecats.judge.metrics.audit import RULES
    from dronecats.report.table import numbers, table_of, words

    successes = counted(told.successes, "success", "successes")
    print(f"{counted(told.episodes, 'episode')}, {told.scored} scored, {successes}")
    print(
        f"{counted(told.declarations, 'declaration')}, {told.false_declarations} of which do not qualify;"
        f" {told.late_declarations} after the cap, in {counted(told.late_episodes, 'episode')}"
    )
    print(f"{counted(told.silent_failures, 'failure')} without a declaration, {told.silent_entered} within the radius")
    rules = [(said, told.flips[name]) for name, (said, _) in RULES.items()]
    rules.append(("strict parsing of what was mended", told.strict))
    columns = (words("rule"), numbers("told"), numbers("success"), numbers("lost"), numbers("gained"))
    print()
    show(table_of(columns, ((said, r.told, r.successes, r.lost, r.gained) for said, r in rules)))
    gain = "" if told.think.gain_m_per_step is None else f", {told.think.gain_m_per_step:+.2f} m/step after them"
    print(f"\nthink: {told.think.thinks} steps, {told.think.matched} matched by their closing rate{gain}")
    print(f"  a stall broken within three steps: {_share(told.think.stalls)}")
    print(f"  the target seen again within three steps: {_share(told.think.losses)}")
    print(f"mended: {told.mended} of {told.steps} decisions, {told.changed} of them another one under strict parsing")


def _share(told: "Followed") -> str:
    return f"{told.think}/{told.of_thinks} after a think, {told.other}/{told.of_others} after another step"
