"""`--view`, as every verb that flies has it."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dronecats.watch.opening import WantedPage


def add_view(group: "argparse._ActionsContainer") -> None:
    """Declare the options."""
    group.add_argument("--view", action="store_true", help="show it in the browser meanwhile: docs/watching.md")
    group.add_argument("--view-port", type=int, metavar="N", help="with --view: of the page (default 8080)")
    group.add_argument("--view-stay", action="store_true", help="with --view: keep the page afterwards, until Ctrl-C")


def view_of(args: argparse.Namespace) -> "WantedPage | None":
    """Return what page is wanted, None where none is. Raises UsageError for words that do not go together."""
    from foundation.errors import UsageError

    if not args.view:
        if args.view_port is not None or args.view_stay:
            stray = "view-port" if args.view_port is not None else "view-stay"
            raise UsageError(f"--{stray} goes with --view; add it or leave --{stray} out")
        return None
    from dronecats.watch.opening import PORT, WantedPage, check

    view = WantedPage(port=PORT if args.view_port is None else args.view_port, stays=args.view_stay)
    check(view)
    return view
