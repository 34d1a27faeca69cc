"""`dronecats episodes ACTION`: what can be flown, what it looks like, whether it is sound, what can be read in it.

One file per action, imported when it is asked for.
"""

import argparse
import importlib

ACTIONS = ("list", "show", "check", "new", "sheet", "optics", "audit", "probe")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb and its actions."""
    parser = verbs.add_parser("episodes")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for action in ACTIONS:
        importlib.import_module(f"dronecats.cli.episodes_{action}").add_parser(actions)
