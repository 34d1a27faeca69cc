"""The options of the verbs that fly many episodes: how much of what, who flies, and where it is kept."""

import argparse
from pathlib import Path

from dronecats.agent.models.providers import PROVIDERS
from dronecats.cli.model_options import add_accounts, add_manners, add_options
from dronecats.cli.view_options import add_view


def add_part(group: "argparse._ActionsContainer") -> None:
    """Declare how much is flown."""
    group.add_argument("--suite", action="append", metavar="NAME", help="quick, one-drone, commanding, all or v1")
    group.add_argument("--flights", type=int, metavar="N", help="of each episode, on seeds of their own (default 1)")
    group.add_argument("--seed", type=int, metavar="S", help="of the first flight; the next have the next (default 0)")
    group.add_argument("--limit", type=int, metavar="N", help="the first N episodes only")
    group.add_argument("--shard", metavar="i/n", help="the i-th of n parts of them, for one machine of n")
    group.add_argument("--full", action="store_true", help="fly to the cap even when the verdict is decided")


def add_pilots(group: "argparse._ActionsContainer") -> None:
    """Declare who flies."""
    group.add_argument(
        "--model", action="extend", nargs="+", metavar="NAME",
        help=f"rows of `dronecats models list`, or PROVIDER/NAME, of {', '.join(PROVIDERS)}",
    )  # fmt: skip
    group.add_argument(
        "--pilot", action="extend", nargs="+", metavar="NAME", help="built-in pilots, which are no models"
    )
    add_options(group)
    add_accounts(group)
    add_manners(group)


def add_place(group: "argparse._ActionsContainer", folder: str) -> None:
    """Declare on what it is flown, and where it is kept; `folder` is what --out is unless it is given."""
    group.add_argument("--speed", metavar="N|max", help="factor on real time; max (default) is lockstep")
    group.add_argument("--rendered", action="store_true", help="draw the frames for pilots that do not look, too")
    group.add_argument("--jobs", type=int, metavar="J", help="flights in the air at a time (default: one per core)")
    group.add_argument("--engine", choices=("local", "ray"), help="this machine (default), or a Ray cluster")
    group.add_argument("--address", metavar="HOST:PORT", help="with --engine ray: of the cluster (default: one here)")
    group.add_argument("--out", type=Path, metavar="DIR", help=f"folder, gone on with (default {folder})")
    group.add_argument("--json", action="store_true", help="end with one JSON object on standard output")
    add_view(group)
