"""`dronecats episodes probe --out DIR`: the pictures of the paper's reading probe."""

import argparse
import dataclasses
import json
from pathlib import Path

from dronecats.cli.output import show


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("probe", help="pictures of a sign and a plate at 4 to 16 m, as a model gets them")
    parser.add_argument("--out", type=Path, metavar="DIR", required=True, help="where the pictures go")
    parser.add_argument("--seed", type=int, default=0, help="of the inscriptions (default 0)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the pictures, their index and a contact sheet."""
    from foundation.errors import UsageError

    if args.seed < 0:
        raise UsageError(f"--seed wants 0 or more, got {args.seed}")
    from dronecats.report.table import numbers, table_of, words
    from episodes.authoring.pictures.probe import write_probe

    probes = write_probe(args.out, args.seed)
    if args.json:
        print(
            json.dumps({"folder": str(args.out), "seed": args.seed, "probes": [dataclasses.asdict(p) for p in probes]})
        )
        return 0
    columns = (words("picture"), words("letters"), numbers("distance", unit="m"), numbers("height of a letter (px)"))
    show(table_of(columns, ((p.file, p.text, f"{p.distance_m:g}", f"{p.letter_px:.2f}") for p in probes)))
    print(f"written to {args.out}, with index.json and contact-sheet.png")
    return 0
