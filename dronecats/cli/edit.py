"""`dronecats edit`: make or change an episode in the browser."""

import argparse
from pathlib import Path


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("edit")
    parser.add_argument("what", nargs="?", default="residential", metavar="MAP|ID", help="default: residential")
    parser.add_argument(
        "--out", type=Path, default=Path("my-episodes"), metavar="DIR", help="where records are written"
    )
    parser.add_argument("--port", type=int, default=8080, help="of the page on this machine (default 8080)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the editor until it is interrupted."""
    import threading
    import webbrowser

    from dronecats.cli import signals
    from foundation import extras
    from foundation.errors import UsageError

    signals.as_interrupts()
    if not 1 <= args.port <= 65535:
        raise UsageError(f"--port {args.port} is no port: choose one from 1 to 65535.")
    extras.require("viser")
    from dronecats.editor.editor import Editor

    print("building the map …", flush=True)
    editor = Editor(args.what, args.out, args.port)
    try:
        print(f"editing at {editor.url} (this machine only); records go to {args.out}/ · Ctrl-C ends", flush=True)
        if not args.no_browser:
            webbrowser.open(editor.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        return 0
    finally:
        editor.close()
    return 0
