"""`dronecats study jitter`: the same flights at one mean rate, which wavers more and more."""

import argparse

from dronecats.cli.study_options import add_study, levels

RATE, CV = "2", "0,0.25,0.5,1,2"  # Hz; deviation over mean


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("jitter", help="the same flights at one mean rate, which wavers more and more")
    parser.add_argument("--rate", metavar="HZ", default=RATE, help=f"replies a second, the mean ({RATE})")
    parser.add_argument("--cv", metavar="X,X,…", default=CV, help=f"deviation of a reply's time over its mean ({CV})")
    parser.add_argument("--rho", metavar="X", help="correlation of one reply's time with the next one's (none)")
    add_study(parser, "runs/study-jitter")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fly; status as of `bench`."""
    from dronecats.cli import study_fly, study_spec

    held = {"rate": args.rate, **({} if args.rho is None else {"jitter_rho": args.rho})}
    return study_fly.fly(study_spec.of_options(args, "jitter", {"jitter_cv": levels(args.cv)}, held))
