"""`dronecats study report DIR`: what a study says, as a page, figures, tables and data."""

import argparse
import json
import shlex
from pathlib import Path


def add_parser(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = actions.add_parser("report", help="what a study says: a page, figures, tables and data")
    parser.add_argument("study", type=Path, metavar="DIR", help="folder of a study")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write the report into (default DIR/report)")
    parser.add_argument(
        "--exclude-above", action="append", default=[], metavar="METRIC=N", help="leave out flights with more of it"
    )
    parser.add_argument("--json", action="store_true", help="print the tables as one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the report; status 0 whatever it says."""
    from dronecats.report.results.exclusion import parse_exclusion
    from dronecats.study.analysis.flown_study import flown_study
    from dronecats.study.report.report_folder import as_json, write
    from foundation.errors import UsageError
    from foundation.extras import not_installed

    out = args.out or args.study / "report"
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file; name a folder")
    words = ["dronecats", "study", "report", str(args.study), *(["--out", str(args.out)] if args.out else [])]
    words += [word for text in args.exclude_above for word in ("--exclude-above", text)]
    exclusions = [parse_exclusion(text) for text in args.exclude_above]
    made = write(flown_study(args.study, exclusions=exclusions), shlex.join(words), out)
    if args.json:
        print(json.dumps(as_json(made)))
        return 0
    for said in (*made.opening, *made.short):
        print(said)
    print(f"page: {made.page}, report: {made.markdown}")
    if made.parquet is None:
        print(f"no Parquet was written: {not_installed('duckdb')}")
    return 0
