"""Where a page is served: the options of every verb that opens one."""

import argparse

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
    from dronecats.view.scene.page import check
    from foundation import extras
    from foundation.errors import UsageError

    given_port, given_hosts = (getattr(args, f"{prefix}{name}".replace("-", "_")) for name in ("port", "host"))
    port, hosts = PORT if given_port is None else given_port, tuple(given_hosts or ())
    if not 1 <= port <= 65535:
        raise UsageError(f"--{prefix}port {port} is no port: choose one from 1 to 65535.")
    check(hosts, f"--{prefix}host")
    extras.require("viser")
    return port, hosts
