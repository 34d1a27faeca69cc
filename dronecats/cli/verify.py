"""`dronecats verify FILE`: an archive of `dronecats submit` judged again, here."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from dronecats.cli.output import show

if TYPE_CHECKING:
    from dronecats.report.archive.verification import Verification

DIFFERS = 4  # exit status: something in the archive is not what it says, or not what ships


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the verb."""
    parser = verbs.add_parser("verify")
    parser.add_argument("file", type=Path, metavar="FILE", help="an archive that `dronecats submit` has made")
    parser.add_argument("--json", action="store_true", help="print one JSON object, an entry of a leaderboard")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
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
