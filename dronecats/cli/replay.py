"""`dronecats replay RUN[/EPISODE] …`: recorded flights in the browser, at any moment, several over one another."""

import argparse
from pathlib import Path

from dronecats.cli.page_options import add_page, page_of


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("replay")
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN[/EPISODE]",
        help="an episode's folder, or a run with only one; several of one episode are laid over one another",
    )
    parser.add_argument("--at", type=float, default=0.0, metavar="S", help="stand there at first (default 0)")
    parser.add_argument("--speed", type=float, default=1.0, metavar="N", help="seconds of flight a second (default 1)")
    add_page(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the page until it is interrupted."""
    import math
    import threading
    import webbrowser

    from dronecats.cli import signals
    from foundation.errors import UsageError

    signals.as_interrupts()
    port, hosts = page_of(args)
    if not (math.isfinite(args.at) and args.at >= 0.0):
        raise UsageError(f"--at wants seconds since the episode began, 0 or more, got {args.at:g}")
    from dronecats.view.replay.moments import flight_moments
    from dronecats.view.replay.page import ReplayPage
    from dronecats.view.replay.player import check_speed
    from dronecats.view.scene.page_hosts import reach

    check_speed(args.speed)
    print("reading the flights and building the map …", flush=True)
    page = ReplayPage([flight_moments(path) for path in args.runs], port, args.speed, args.at, hosts)
    try:
        print(f"replay at {page.url} ({reach(hosts)}) · space plays, ? shows the keys · Ctrl-C ends", flush=True)
        if not args.no_browser:
            webbrowser.open(page.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        return 0
    finally:
        page.close()
    return 0
