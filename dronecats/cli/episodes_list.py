"""`dronecats episodes list`: one line per episode."""

import argparse
import json

from dronecats.cli.output import show


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("list", help="one line per episode")
    parser.add_argument("--suite", default="all", help="one-drone, commanding, quick, all (default) or v1")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the episodes."""
    from dronecats.report.table import numbers, table_of, words
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
    columns = (words("id"), words("map"), words("cell"), numbers("drones"), numbers("par"), words("instruction"))
    show(table_of(columns, ((r.id, r.map, r.cell, len(r.starts), pars.get(r.id), r.instruction) for r in records)))
    return 0
