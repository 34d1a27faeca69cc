"""`dronecats episodes list`: one line per episode."""

import argparse
import json


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("list", help="one line per episode")
    parser.add_argument("--suite", default="all", help="one-drone, commanding, quick, all (default) or v1")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the episodes."""
    from episodes.records import catalogue, suites
    from episodes.records.baselines import load_par

    pars = load_par()
    records = [catalogue.load(episode) for episode in suites.ids(args.suite)]
    if args.json:
        rows = [
            {
                "id": r.id,
                "map": r.map,
                "cell": r.cell,
                "suites": list(suites.of(r.id)),
                "drones": len(r.starts),
                "par": pars.get(r.id),
                "instruction": r.instruction,
            }
            for r in records
        ]
        print(json.dumps({"episodes": rows}))
        return 0
    for r in records:
        drones = f"{len(r.starts)} drone{'s' * (len(r.starts) > 1)}"
        print(f"{r.id:32} {r.map:12} {r.cell:17} {drones:9} par {pars.get(r.id, '-'):>3}  {r.instruction}")
    return 0
