"""The options of the actions of `dronecats study` that fly."""

import argparse

from dronecats.cli.campaign_options import add_part, add_pilots, add_place
from dronecats.cli.disturbance_options import add_disturbance_options


def add_study(parser: argparse.ArgumentParser, folder: str) -> None:
    """Declare what is flown, who flies it, and where it is kept; `folder` is what --out is unless it is given."""
    what = parser.add_argument_group("what is flown")
    what.add_argument("--episodes", type=levels, metavar="ID,ID,…", help="these, by id or file")
    what.add_argument("--cells", type=levels, metavar="CELL,…", help="the suite's episodes (of all) of these cells")
    what.add_argument("--maps", type=levels, metavar="MAP,…", help="the suite's episodes (of all) on these maps")
    add_part(what)
    what.add_argument("--seconds", type=float, metavar="S", help="length of a flight, vehicle time (300)")
    what.add_argument(
        "--hold", action="append", metavar="FACTOR=LEVEL", help="set this in every flight, too: docs/studies.md"
    )
    add_pilots(parser.add_argument_group("who flies"))
    add_disturbance_options(parser)
    add_place(parser.add_argument_group("run"), folder)


def levels(text: str) -> list[str]:
    """Return the words of a list with commas."""
    return [word.strip() for word in text.split(",") if word.strip()]
