"""`dronecats models ACTION`: which models are known by name, what is sent to one, and what it answers.

One file per action, imported when it is asked for.
"""

import argparse
import importlib

ACTIONS = ("list", "show", "check")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb and its actions."""
    parser = verbs.add_parser("models")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for action in ACTIONS:
        importlib.import_module(f"dronecats.cli.models_{action}").add_parser(actions)
