"""The options of every verb that opens a page: where it is served, and `--view` of the verbs that fly."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dronecats.view.live.opening import WantedPage

PORT = 8090  # above the cameras of simulators, which begin at 8080


def add_page(group: "argparse._ActionsContainer", prefix: str = "") -> None:
    """Declare the options. `prefix` stands before their names where the page is not the verb's only purpose."""
    what = f"with --{prefix.rstrip('-')}: of the page" if prefix else "of the page on this machine"
    group.add_argument(f"--{prefix}port", type=int, metavar="N", help=f"{what} (default {PORT})")
    group.add_argument(
        f"--{prefix}host",
        action="append",
        metavar="NAME",
        help="another host name under which the page opens, for example that of a reverse proxy; may be repeated",
    )


def page_of(args: argparse.Namespace, prefix: str = "") -> tuple[int, tuple[str, ...]]:
    """Return the port of the page, and its host names beside the loopback ones.

    Raises UsageError for a value that cannot be used, and when the package that serves pages is not installed.
    """
    from dronecats.view.scene.page_hosts import check
    from foundation import extras
    from foundation.errors import UsageError

    given_port, given_hosts = (getattr(args, f"{prefix}{name}".replace("-", "_")) for name in ("port", "host"))
    port, hosts = PORT if given_port is None else given_port, tuple(given_hosts or ())
    if not 1 <= port <= 65535:
        raise UsageError(f"--{prefix}port {port} is no port: choose one from 1 to 65535.")
    check(hosts, f"--{prefix}host")
    extras.require("viser")
    return port, hosts


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
