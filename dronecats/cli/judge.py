"""`dronecats judge RUN`: the verdicts of a run, derived again from its logs alone."""

import argparse
import json
from pathlib import Path

AGREES = {True: "agrees with verdict.json", False: "DIFFERS from verdict.json", None: "nothing stored to compare"}


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("judge")
    parser.add_argument("run_dir", type=Path, help="a run folder, or the folder of one episode in it")
    parser.add_argument("--delta", type=float, default=5.0, help="success radius in metres (default 5)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the verdicts; status 0 whatever they are."""
    from dronecats.judge.distances import sentence
    from dronecats.judge.episode import judge_run

    episodes = judge_run(args.run_dir, args.delta)
    if args.json:
        print(json.dumps({"episodes": episodes}))
        return 0
    for episode, verdict in episodes.items():
        ne_m = "     –" if verdict["ne_m"] is None else f"{verdict['ne_m']:6.2f}"
        agrees = AGREES[verdict["stored_agrees"]]
        print(
            f"{episode:32} {verdict['outcome']:13} NE {ne_m} m  {verdict['steps']:3} steps"
            f"  {verdict['declarations']:3} declarations  {agrees}"
        )
        if verdict.get("distances"):
            print(f"{'':32} {sentence(verdict['distances'], args.delta)}")
        if verdict["error"]:
            print(f"{'':32} {verdict['error']}")
    return 0
