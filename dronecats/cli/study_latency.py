"""`dronecats study latency`: the same flights with one reply time after another."""

import argparse

from dronecats.cli.study_options import add_study, levels

VALUES = "0,0.25,0.5,1,2,4"  # s


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("latency", help="the same flights with one reply time after another")
    parser.add_argument("--values", metavar="S,S,…", default=VALUES, help=f"seconds that a reply takes ({VALUES})")
    add_study(parser, "runs/study-latency")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly; status as of `bench`."""
    from dronecats.cli import study_fly, study_spec

    return study_fly.fly(study_spec.of_options(args, "latency", {"latency": levels(args.values)}))
