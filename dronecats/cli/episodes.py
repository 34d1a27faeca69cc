"""`dronecats episodes list`: what can be flown."""

import argparse
import json


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("episodes", help="list the episodes")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="one line per episode")
    listing.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the episodes."""
    from episodes import catalogue

    records = [catalogue.load(episode) for episode in catalogue.ids()]
    if args.json:
        rows = [
            {"id": r.id, "map": r.map, "cell": r.cell, "drones": len(r.starts), "instruction": r.instruction}
            for r in records
        ]
        print(json.dumps({"episodes": rows}))
        return 0
    for r in records:
        print(f"{r.id:36} {r.map:12} {r.cell:17} {len(r.starts)} drone{'s' * (len(r.starts) > 1):1}  {r.instruction}")
    return 0
