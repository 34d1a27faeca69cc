"""`dronecats film RUN/EPISODE --out FILE.mp4`: a film of a flight, from its folder alone."""

import argparse
import sys
from pathlib import Path
from typing import Any

SIZE, FPS = (1280, 720), 30
GIF_SIZE, GIF_FPS = (480, 270), 6
SUFFIXES = (".mp4", ".gif")


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("film")
    parser.add_argument("episode", type=Path, metavar="RUN/EPISODE", help="an episode's folder, or a run with only one")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the film: FILE.mp4, or FILE.gif")
    parser.add_argument(
        "--gif", action="store_true", help="a small picture that moves, for a page; FILE.gif implies it"
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="N", help="seconds of flight a second (default 1)")
    parser.add_argument("--from", dest="from_s", type=float, default=0.0, metavar="S", help="begin there (default 0)")
    parser.add_argument("--to", dest="to_s", type=float, metavar="S", help="end there (default: the flight's end)")
    parser.add_argument("--size", type=_size, metavar="WxH", help="pixels (default 1280x720, of a GIF 480x270)")
    parser.add_argument("--fps", type=int, metavar="N", help="pictures a second (default 30, of a GIF 6)")
    parser.add_argument("--drone", type=int, metavar="N", help="follow this one of a fleet alone (1 is the first)")
    parser.add_argument("--jobs", type=int, metavar="N", help="processes that draw (default: one a core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the film; status 0 when it is there."""
    import json
    import time

    from dronecats.view.film.film import make, said
    from dronecats.view.film.plan import filmable, plan
    from foundation.errors import UsageError

    suffix = args.out.suffix.lower()
    if suffix not in SUFFIXES or (args.gif and suffix != ".gif"):
        raise UsageError(
            f"--out wants a file that ends in {'.gif' if args.gif else ' or '.join(SUFFIXES)}, got {args.out}"
        )
    if args.jobs is not None and args.jobs < 1:
        raise UsageError(f"--jobs wants 1 or more, got {args.jobs}")
    gif = suffix == ".gif"
    wanted = plan(
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
        bar = _bar(wanted.pictures, done)
        return bar.update

    try:
        codec = make(wanted, args.out, args.jobs, progress)
    finally:
        if bar is not None:
            bar.close()
    wall = time.monotonic() - began
    size = args.out.stat().st_size
    if args.json:
        told_of = {"film": str(args.out), "seconds": round(wanted.seconds, 3), "pictures": wanted.pictures,
                   "fps": wanted.fps, "size": [wanted.width, wanted.height], "codec": codec, "bytes": size,
                   "wall_s": round(wall, 1)}  # fmt: skip
        print(json.dumps(told_of))
    else:
        print(f"film: {args.out}, {wanted.seconds:.1f} s of {wanted.width}×{wanted.height} at {wanted.fps} a second, "
              f"{size / 1e6:.1f} MB; {said(codec)}")  # fmt: skip
    return 0


def _bar(total: int, done: int) -> Any:
    from tqdm import tqdm

    from dronecats.cli.output import Drawing

    seldom = 0.1 if sys.stderr.isatty() else 10.0  # s between two lines: a log is not to be filled with bars
    return tqdm(total=total, initial=done, unit="picture", dynamic_ncols=True, mininterval=seldom, file=Drawing())


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"wants WxH such as 1280x720, got '{text[:40]}'") from None
