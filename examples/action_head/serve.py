"""Serve a trained head as a model: `python -m examples.action_head.serve head.pt --port 8765`."""

import argparse
import signal
import threading
from pathlib import Path

from dronecats.cli.exit_status import exit_status
from dronecats.pilots.server import PilotServer
from examples.action_head.pilot import pilot
from foundation.errors import UsageError

NAME = "action-head"


def server(file: Path, port: int, threads: int) -> PilotServer:
    """Return a server of a trained head, which is not started yet. Raises UsageError for a wrong file or port."""
    import torch

    from examples.action_head.network import load

    torch.set_num_threads(threads)
    head, declares_at = load(file)
    return PilotServer(pilot(head.outlook, declares_at), NAME, port=port)


def main(words: list[str] | None = None) -> int:
    """Read the command line and serve until interrupted."""
    parser = argparse.ArgumentParser(prog="python -m examples.action_head.serve", description=__doc__)
    parser.add_argument("head", type=Path, help="file that `python -m examples.action_head.train` has written")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="TCP port (default: a free one)")
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="threads of PyTorch (default 1)")
    args = parser.parse_args(words)
    if args.threads < 1 or not 0 <= args.port <= 65535:
        raise UsageError("--threads must be 1 or more, and --port 0 to 65535.")
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with server(args.head, args.port, args.threads) as serving:
        print(f"--model local/{NAME} --base-url {serving.base_url}", flush=True)
        ended.wait()
    return 0


if __name__ == "__main__":
    raise SystemExit(exit_status("action_head", main))
