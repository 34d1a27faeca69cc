"""`dronecats episodes probe --out DIR`: the pictures of the paper's reading probe."""

import argparse
import dataclasses
import json
from pathlib import Path


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
    from episodes.authoring.pictures.probe import summary, write_probe

    probes = write_probe(args.out, args.seed)
    if args.json:
        print(
            json.dumps({"folder": str(args.out), "seed": args.seed, "probes": [dataclasses.asdict(p) for p in probes]})
        )
        return 0
    for line in summary(probes):
        print(line)
    print(f"written to {args.out}, with index.json and contact-sheet.png")
    return 0
