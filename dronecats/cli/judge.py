"""`dronecats judge RUN`: the verdicts of a run, derived again from its logs alone."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foundation.protocol import RADIUS_M

if TYPE_CHECKING:
    from dronecats.judge.episode import Judged

DIFFERS = 4  # exit status: a stored verdict is not what the logs say, or the logs contradict themselves


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("judge")
    parser.add_argument("run_dir", type=Path, help="a run folder, or the folder of one episode in it")
    parser.add_argument("--delta", type=float, default=RADIUS_M, help="success radius in metres (default 5)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the verdicts; status 0 whatever they are, and 4 when something stored does not agree with them."""
    from dronecats.judge.episode import judge_run

    episodes = judge_run(args.run_dir, args.delta, reread)
    if args.json:
        print(json.dumps({"episodes": {episode: judged.as_json() for episode, judged in episodes.items()}}))
    else:
        for episode, judged in episodes.items():
            _print(episode, judged)
    return DIFFERS if any(judged.doubtful for judged in episodes.values()) else 0


def reread(reply: str, drones: int, mended: bool = False) -> list[list[dict[str, Any] | None]]:
    """Return, for each drone, the actions that a reply may be read as: one for each order of a point's axes.

    `mended`: as the lenient reading has it. Where that mended nothing, it is the strict one.
    """
    from dronecats.agent.reply.reading import reading

    read = zip(
        *(reading(reply, drones, order, "lenient" if mended else "strict") for order in ("xy", "yx")), strict=True
    )
    return [[one.action.as_json() if one.action else None for one in each] for each in read]


def _print(episode: str, judged: "Judged") -> None:
    from dronecats.judge.commanding import sentence as sent
    from dronecats.judge.distances import sentence

    verdict = judged.verdict
    ne_m = "     –" if verdict.ne_m is None else f"{verdict.ne_m:6.2f}"
    cut_off = ", cut off there" if verdict.outcome == "success" and verdict.censored else ""
    print(
        f"{episode:32} {verdict.outcome:13} NE {ne_m} m  {verdict.steps:3} steps"
        f"  {verdict.declarations:3} declarations{cut_off}  {_agreement(judged)}"
    )
    if verdict.outcome == "censored":
        print(f"{'':32} cut off at its first success: whether it would have been one at this radius is not known")
    if verdict.distances:
        print(f"{'':32} {sentence(verdict.distances, verdict.delta_m)}")
    if verdict.commanding:
        print(f"{'':32} {sent(verdict.commanding)}")
    for said in (verdict.error, verdict.note, *judged.contradictions):
        if said:
            print(f"{'':32} {said}")


def _agreement(judged: "Judged") -> str:
    """Return what verdict.json is beside the verdict."""
    stored = judged.stored
    if stored is None:
        return "nothing stored to compare"
    version = ", stored by an older version" if stored.older else ""
    if stored.agrees:
        return f"agrees with verdict.json{version}"
    names = f" in {', '.join(stored.differing)}" if stored.differing else ", which is damaged"
    return f"DIFFERS from verdict.json{names}{version}"
