"""Verbs `submit`, `verify` and `leaderboard`: archives of runs, and a page of verified archives."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.output import show
from foundation.errors import UsageError
from foundation.whole_file import whole_file, write_text


def add_submit_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="run folders, or folders of runs")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the archive, FILE.tar.xz")
    parser.add_argument("--name", help="of the entry (the pilot's)")
    parser.add_argument("--note", default="", help="a sentence about the entry")
    parser.add_argument("--with-frames", action="store_true", help="take in what the pilot saw, not digests alone")
    parser.add_argument("--partial", action="store_true", help="submit what is no whole suite, or not scored, marked")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run_submit)


def run_submit(args: argparse.Namespace) -> int:
    """Write the archive and say what is in it; status 0."""
    from dronecats.cli.submit import as_json, print_verification
    from dronecats.judge.metrics.judging import reread
    from dronecats.report.archive.scrubbing import secrets_of
    from dronecats.report.archive.submission import submit
    from dronecats.report.archive.verification import verify
    from dronecats.report.recorded.run import recorded_runs

    if not args.out.name.endswith(".tar.xz"):
        raise UsageError(f"--out wants the name of a file that ends with .tar.xz, got {args.out.name}")
    with whole_file(args.out) as draft:
        submit(
            recorded_runs(args.runs), draft, name=args.name, note=args.note, partial=args.partial,
            with_frames=args.with_frames, secrets=secrets_of(os.environ),
        )  # fmt: skip
        told = verify(draft, reread)
        if not told.verified:
            raise UsageError(f"the archive would not be verified: {told.differences[0]}; `dronecats judge` says more")
    if args.json:
        print(as_json(told))
    else:
        print(f"{args.out}  {told.archive_bytes / 1e6:.1f} MB  SHA-256 {told.archive_sha256}")
        print_verification(told)
    return 0


if TYPE_CHECKING:
    from dronecats.report.archive.verification import Verification

DIFFERS = 4  # exit status: something in the archive is not what it says, or not what ships


def add_verify_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("file", type=Path, metavar="FILE", help="an archive that `dronecats submit` has made")
    parser.add_argument("--json", action="store_true", help="print one JSON object, an entry of a leaderboard")
    parser.set_defaults(run=run_verify)


def run_verify(args: argparse.Namespace) -> int:
    """Print what was found; status 0 when nothing differs, 4 when something does."""
    from dronecats.judge.metrics.judging import reread
    from dronecats.report.archive.verification import verify

    told = verify(args.file, reread)
    if args.json:
        print(as_json(told))
    else:
        print_verification(told)
    return 0 if told.verified else DIFFERS


def as_json(told: "Verification") -> str:
    """Return it as JSON, on one line."""
    import msgspec

    return msgspec.json.encode(told).decode()


def print_verification(told: "Verification") -> None:
    """Print the scores as derived here, then what differs, what was checked and what nobody can tell."""
    from dronecats.report.table import numbers, table_of, words

    kind = "a model" if told.is_model else "a built-in pilot, no model"
    print(f"{told.name}: {told.pilot}, {kind}; {told.flights} × suite {told.suite or '(none)'}, {told.steps} steps")
    if told.partial:
        print(f"PARTIAL: {told.partial}")
    ne = numbers("NE", unit="m", decimals=2)
    columns = (words("cell"), numbers("succeeded"), numbers("of"), ne, numbers("not scored"))
    cells = told.cells.items()
    show(table_of(columns, ((cell or "?", of.successes, of.scored, of.ne_m, of.unscored) for cell, of in cells)))
    for said in told.differences:
        print(f"DIFFERS: {said}")
    for said in told.checked if told.verified else ():
        print(f"checked: {said}")
    for said in told.unchecked:
        print(f"not checked: {said}")


if TYPE_CHECKING:
    from dronecats.report.archive.verification import Verification


def add_leaderboard_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="what `dronecats verify --json` has printed, or an archive"
    )
    parser.add_argument("--out", type=Path, metavar="PAGE", help="Markdown file (the standard output)")
    parser.set_defaults(run=run_leaderboard)


def run_leaderboard(args: argparse.Namespace) -> int:
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
