"""`dronecats study ACTION`: what a slow or wavering model, a bad wire or the wind costs.

One file per action; `study_fly.py` has those that fly.
"""

import argparse
import importlib

ACTIONS = ("fly", "rate", "report", "loop", "load")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb and its actions."""
    parser = verbs.add_parser("study")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for action in ACTIONS:
        importlib.import_module(f"dronecats.cli.study_{action}").add_parser(actions)
