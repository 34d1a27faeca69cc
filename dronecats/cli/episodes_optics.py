"""`dronecats episodes optics FILE`: one place under every camera option."""

import argparse
from pathlib import Path


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("optics", help="draw one place under every lens, sensor and weather option")
    parser.add_argument("file", type=Path, metavar="FILE", help="picture to write (.jpg)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the sheet."""
    from episodes.authoring.pictures.optics_sheet import write

    write(args.file)
    print(args.file)
    return 0
