"""`dronecats edit`: make or change an episode in the browser."""

import argparse
from pathlib import Path

from dronecats.cli.page_options import add_page, page_of


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("edit")
    parser.add_argument("what", nargs="?", default="residential", metavar="MAP|ID", help="default: residential")
    parser.add_argument(
        "--out", type=Path, default=Path("my-episodes"), metavar="DIR", help="where records are written"
    )
    add_page(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address and open nothing")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the editor until it is interrupted."""
    import threading
    import webbrowser

    from dronecats.cli import signals

    signals.as_interrupts()
    port, hosts = page_of(args)
    from dronecats.view.editor.editor import Editor
    from dronecats.view.scene.page_hosts import reach

    print("building the map …", flush=True)
    editor = Editor(args.what, args.out, port, hosts)
    try:
        print(f"editing at {editor.url} ({reach(hosts)}); records go to {args.out}/ · Ctrl-C ends", flush=True)
        if not args.no_browser:
            webbrowser.open(editor.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        return 0
    finally:
        editor.close()
    return 0
