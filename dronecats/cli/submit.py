"""Verbs `submit`, `verify` and `leaderboard`: make an archive of runs, verify archives, write a leaderboard page."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.next_commands import print_next
from dronecats.cli.output import print_wrapped, show
from dronecats.report.table import numbers, table_of, words
from foundation.errors import UsageError
from foundation.files import file_errors_as, whole_file, write_text
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.report.leaderboard.verification import Verification

DIFFERS = 4  # exit status of `verify`: the logs in the archive contradict its claims, or its episodes are modified


def add_submit_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="run folders, or folders of runs")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the archive, FILE.tar.xz")
    parser.add_argument("--name", help="name of the entry (default: the pilot's name)")
    parser.add_argument("--note", default="", help="a sentence about the entry")
    parser.add_argument("--with-frames", action="store_true", help="include the frames, not only their digests")
    parser.add_argument(
        "--partial",
        action="store_true",
        help="also accept an incomplete suite or unscored episodes; marks the entry as partial",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_submit)


def _submit(args: argparse.Namespace) -> int:
    """Write the archive, verify it, and print the result."""
    from dronecats.report.leaderboard.submission import secrets_of, submit
    from dronecats.report.leaderboard.verification import verify
    from dronecats.report.recorded.run import recorded_runs

    if not args.out.name.endswith(".tar.xz"):
        raise UsageError(f"--out must be a file name that ends with .tar.xz, got {args.out.name}")
    with whole_file(args.out) as draft:
        submit(
            recorded_runs(args.runs), draft, name=args.name, note=args.note, partial=args.partial,
            with_frames=args.with_frames, secrets=secrets_of(os.environ),
        )  # fmt: skip
        entry = verify(draft)
        if not entry.verified:
            raise UsageError(f"the archive would fail verification: {entry.differences[0]}. See: dronecats judge")
    if args.json:
        print(_as_json(entry))
    else:
        print(f"{args.out}  {entry.archive_bytes / 1e6:.1f} MB  SHA-256 {entry.archive_sha256}")
        _print(entry)
        print_next("submit", archive=args.out)
    return 0


def add_verify_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="an archive made by `dronecats submit`")
    parser.add_argument("--json", action="store_true", help="print one JSON object, an entry of a leaderboard")
    parser.set_defaults(run=_verify)


def _verify(args: argparse.Namespace) -> int:
    """Print the result of the verification. Return 0 if there are no differences, otherwise DIFFERS."""
    from dronecats.report.leaderboard.verification import verify

    entry = verify(args.file)
    if args.json:
        print(_as_json(entry))
    else:
        _print(entry)
        if entry.verified:
            print_next("verify", archive=args.file)
    return 0 if entry.verified else DIFFERS


def _as_json(entry: "Verification") -> str:
    import msgspec

    return msgspec.json.encode(entry).decode()


def _print(entry: "Verification") -> None:
    """Print the scores, the differences from the archive's claims, and what was checked and not checked."""
    kind = "a model" if entry.is_model else "a built-in pilot, not a model"
    print(
        f"{entry.name}: {entry.pilot}, {kind}; {counted(entry.flights, 'flight')} of each episode,"
        f" suite {entry.suite or '(none)'}, {counted(entry.steps, 'step')}"
    )
    if entry.partial:
        print(f"PARTIAL: {entry.partial}")
    ne = numbers("NE", unit="m", decimals=2)
    columns = (words("cell"), numbers("succeeded"), numbers("of"), ne, numbers("not scored"))
    cells = entry.cells.items()
    show(table_of(columns, ((cell or "?", of.successes, of.scored, of.ne_m, of.unscored) for cell, of in cells)))
    for label, sentences in (
        ("DIFFERS", entry.differences),
        ("checked", entry.checked if entry.verified else ()),
        ("not checked", entry.unchecked),
    ):
        if sentences:
            print(f"{label}:")
            print_wrapped(*(f"  - {sentence}" for sentence in sentences), indent="    ")


def add_leaderboard_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="archives, or output of `dronecats verify --json`"
    )
    parser.add_argument("--out", type=Path, metavar="PAGE", help="Markdown file (default: standard output)")
    parser.set_defaults(run=_leaderboard)


def _leaderboard(args: argparse.Namespace) -> int:
    from dronecats.report.leaderboard.leaderboard import entry, page
    from dronecats.report.leaderboard.verification import verify

    text = page(entry(file) if file.suffix == ".json" else verify(file) for file in args.files)
    if args.out is None:
        print(text, end="")
        return 0
    with file_errors_as(UsageError, f"{args.out} cannot be written"):
        write_text(args.out, text)
    return 0
