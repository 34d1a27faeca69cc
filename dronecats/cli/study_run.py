"""`dronecats study run FILE.toml`: any factors, by any design."""

import argparse
from pathlib import Path

from dronecats.cli.study_options import add_study


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("run", help="what a file says: any factors, by any design")
    parser.add_argument("file", type=Path, metavar="FILE", help="the study, .toml: docs/studies.md")
    add_study(parser, "runs/NAME-OF-THE-FILE")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly; status as of `bench`."""
    from dronecats.cli import study_fly, study_spec

    return study_fly.fly(study_spec.of_file(args))
