"""`dronecats leaderboard FILE… --out PAGE`: a page of verified entries."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from foundation.errors import UsageError
from foundation.whole_file import write_text

if TYPE_CHECKING:
    from dronecats.report.archive.verification import Verification


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("leaderboard")
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="what `dronecats verify --json` has printed, or an archive"
    )
    parser.add_argument("--out", type=Path, metavar="PAGE", help="Markdown file (the standard output)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the page; status 0."""
    from dronecats.report.results.leaderboard import page

    told = page(map(_entry, args.files))
    if args.out is None:
        print(told, end="")
        return 0
    try:
        write_text(args.out, told)
    except OSError as error:
        raise UsageError(f"{args.out} cannot be written: {error.strerror}") from None
    return 0


def _entry(file: Path) -> "Verification":
    from dronecats.judge.metrics.judging import reread
    from dronecats.report.archive.verification import verify
    from dronecats.report.results.leaderboard import entry

    return entry(file) if file.suffix == ".json" else verify(file, reread)
