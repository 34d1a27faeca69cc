"""Verbs `replay` and `film`: show a recorded flight in the browser or as a video."""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

from dronecats.cli.exit_status import interrupt_on_signals
from dronecats.cli.options import add_page, page_of, serve
from dronecats.cli.output import LOG_PERIOD_S, print_line, progress_bar
from dronecats.view.replay.player import check_speed
from dronecats.view.scene.page_hosts import reach
from foundation.errors import UsageError

SIZE, FPS = (1280, 720), 30
GIF_SIZE, GIF_FPS = (480, 270), 6
GIF_FPS_MAX = 50  # with more, a frame lasts less than 20 ms, and browsers show it for 100 ms
SUFFIXES = (".mp4", ".gif")


def add_replay_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN[/EPISODE]",
        help="a run with one episode, or an episode's folder; several flights of one episode share the scene",
    )
    parser.add_argument(
        "--at", type=float, default=0.0, metavar="S", help="second of the flight to begin at (default 0)"
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="N", help="seconds of flight a second (default 1)")
    add_page(parser)
    parser.add_argument("--no-browser", action="store_true", help="print the address, and open no browser")
    parser.set_defaults(run=_replay)


def _replay(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    interrupt_on_signals()
    port, hosts = page_of(args)
    if not (math.isfinite(args.at) and args.at >= 0.0):
        raise UsageError(f"--at must be seconds since the episode began, 0 or more, got {args.at:g}")
    from dronecats.view.replay.moments import flight_moments
    from dronecats.view.replay.page import ReplayPage

    check_speed(args.speed)
    print_line("reading the flights and building the map …")
    page = ReplayPage([flight_moments(path) for path in args.runs], port, args.speed, args.at, hosts)
    return serve(
        page,
        f"replay at {page.url} ({reach(hosts)})\nspace plays, ? shows the keys, Ctrl-C ends",
        browser=not args.no_browser,
    )


def add_film_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "episode", type=Path, metavar="RUN[/EPISODE]", help="a run with one episode, or an episode's folder"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the film: FILE.mp4, or FILE.gif")
    parser.add_argument("--gif", action="store_true", help="write a GIF. --out FILE.gif is enough")
    parser.add_argument("--speed", type=float, default=1.0, metavar="N", help="seconds of flight a second (default 1)")
    parser.add_argument(
        "--from",
        dest="from_s",
        type=float,
        default=0.0,
        metavar="S",
        help="second of the flight to begin at (default 0)",
    )
    parser.add_argument("--to", dest="to_s", type=float, metavar="S", help="last second (default: the end)")
    parser.add_argument(
        "--size", type=_size, metavar="WxH", help="size in pixels (default 1280x720, for a GIF 480x270)"
    )
    parser.add_argument("--fps", type=int, metavar="N", help="pictures a second (default 30, for a GIF 6)")
    parser.add_argument("--drone", type=int, metavar="N", help="follow only this drone of a fleet; 1 is the first")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes for the drawing (default: one per core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_film)


def _film(args: argparse.Namespace) -> int:
    from dronecats.view.film.film import describe_codec, make
    from dronecats.view.film.plan import filmable, plan

    suffix = args.out.suffix.lower()
    if suffix not in SUFFIXES or (args.gif and suffix != ".gif"):
        raise UsageError(
            f"--out must be a file that ends in {'.gif' if args.gif else ' or '.join(SUFFIXES)}, got {args.out}"
        )
    if args.jobs is not None and args.jobs < 1:
        raise UsageError(f"--jobs must be 1 or more, got {args.jobs}")
    gif = suffix == ".gif"
    if gif and args.fps is not None and args.fps > GIF_FPS_MAX:
        raise UsageError(
            f"--fps of a GIF must be {GIF_FPS_MAX} or less, got {args.fps}: browsers show faster GIFs slowly"
        )
    film = plan(
        filmable(args.episode),
        size=args.size or (GIF_SIZE if gif else SIZE),
        fps=args.fps if args.fps is not None else GIF_FPS if gif else FPS,
        speed=args.speed,
        from_s=args.from_s,
        to_s=args.to_s,
        drone=None if args.drone is None else args.drone - 1,
    )
    began = time.monotonic()
    bar = None

    def progress(done: int) -> Any:
        nonlocal bar
        bar = progress_bar(film.pictures, done, "picture", LOG_PERIOD_S)
        return bar.update

    try:
        codec = make(film, args.out, args.jobs, progress)
    finally:
        if bar is not None:
            bar.close()
    wall = time.monotonic() - began
    size = args.out.stat().st_size
    if args.json:
        summary = {"film": str(args.out), "seconds": round(film.seconds, 3), "pictures": film.pictures,
                   "fps": film.fps, "size": [film.width, film.height], "codec": codec, "bytes": size,
                   "wall_s": round(wall, 1)}  # fmt: skip
        print(json.dumps(summary))
    else:
        print(f"film: {args.out}, {film.seconds:.1f} s of {film.width}×{film.height} at {film.fps} a second, "
              f"{size / 1e6:.1f} MB; {describe_codec(codec)}")  # fmt: skip
    return 0


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be WxH such as 1280x720, got '{text[:40]}'") from None
