"""`--view`, as every verb that flies has it."""

import argparse
from typing import TYPE_CHECKING

from dronecats.cli.page_options import add_page, page_of

if TYPE_CHECKING:
    from dronecats.view.live.opening import WantedPage


def add_view(group: "argparse._ActionsContainer") -> None:
    """Declare the options."""
    group.add_argument("--view", action="store_true", help="show it in the browser meanwhile: docs/watching.md")
    add_page(group, "view-")
    group.add_argument("--view-stay", action="store_true", help="with --view: keep the page afterwards, until Ctrl-C")


def view_of(args: argparse.Namespace) -> "WantedPage | None":
    """Return what page is wanted, None where none is. Raises UsageError for words that do not go together."""
    from foundation.errors import UsageError

    if not args.view:
        present = {"view-port": args.view_port is not None, "view-host": args.view_host, "view-stay": args.view_stay}
        if stray := next((name for name, given in present.items() if given), None):
            raise UsageError(f"--{stray} goes with --view; add it or leave --{stray} out")
        return None
    from dronecats.view.live.opening import WantedPage

    port, hosts = page_of(args, "view-")
    return WantedPage(port=port, hosts=hosts, stays=args.view_stay)
