"""Verbs `query` and `export`: read runs with SQL, and convert them to other formats."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Iterable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import show
from foundation.errors import UsageError
from foundation.whole_file import whole_file

if TYPE_CHECKING:
    from dronecats.report.results.database import Selected
    from dronecats.report.table import ReportTable


def add_query_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument("sql", nargs="?", metavar="SELECT", help="one SELECT, in quotes")
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN", help="run folders, or folders of runs (./runs)")
    parser.add_argument("--tables", action="store_true", help="print the tables with their columns and units")
    parser.add_argument("--csv", metavar="FILE", help="write the answer as CSV, - for the standard output")
    parser.add_argument("--parquet", type=Path, metavar="FILE", help="write the answer as Parquet")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run_query)


def run_query(args: argparse.Namespace) -> int:
    """Print what the query says; status 0, damaged episodes named on standard error."""
    if args.tables:
        show(*_run_tables())
        return 0
    if args.sql is None:
        raise UsageError('say what to ask, such as "SELECT * FROM runs"; --tables prints what there is')
    if args.json and args.csv == "-":
        raise UsageError("--json and --csv - both go to the standard output; choose one")
    for file in (args.parquet, None if args.csv in (None, "-") else Path(args.csv)):
        if file is not None and not file.absolute().parent.is_dir():
            raise UsageError(f"there is no folder {file.parent} to write {file.name} into")
    answer = _answer(args)
    if args.csv is not None:
        _csv(answer, args.csv)
    if args.json:
        print(json.dumps({"rows": [_as_object(answer, row) for row in answer.rows], "damaged": [*answer.damage]}))
    elif args.csv is None and args.parquet is None:
        show(_table(answer))
    return 0


def _run_tables() -> "list[ReportTable]":
    """Return the tables that can be asked, their columns as rows."""
    from dronecats.report.results.tables import TABLES
    from dronecats.report.table import table_of, words

    columns = (words("column"), words("type"), words("what"))
    return [
        replace(table_of(columns, ((c.name, c.type, c.description) for c in of.columns)), title=name, caption=of.about)
        for name, of in TABLES.items()
    ]


def _answer(args: argparse.Namespace) -> "Selected":
    from dronecats.report.recorded.run import recorded_runs
    from dronecats.report.results.database import query

    try:
        answer = query(args.sql, recorded_runs(args.runs or [Path("runs")]), args.parquet)
    except OSError as error:
        raise UsageError(f"{args.parquet} cannot be written: {error.strerror}") from None
    for said in answer.damage:
        print(f"dronecats query: left out but for its row in episodes: {said}", file=sys.stderr)
    return answer


def _csv(answer: "Selected", file: str) -> None:
    told = [answer.columns, *([_cell(value) for value in row] for row in answer.rows)]
    if file == "-":
        csv.writer(sys.stdout, lineterminator="\n").writerows(told)
        return
    path = Path(file)
    try:
        with whole_file(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
            csv.writer(out, lineterminator="\n").writerows(told)
    except OSError as error:
        raise UsageError(f"{file} cannot be written: {error.strerror}") from None


def _cell(value: Any) -> Any:
    """Return a value as a cell of CSV has it: lists and structs as JSON, an empty one for null."""
    return json.dumps(_plain(value)) if isinstance(value, list | tuple | dict | bool) else value


def _as_object(answer: "Selected", row: Iterable[Any]) -> dict[str, Any]:
    return {name: _plain(value) for name, value in zip(answer.columns, row, strict=True)}


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: what is no number is null, and what JSON has no word for is text."""
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, Decimal):
        value = float(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _table(answer: "Selected") -> "ReportTable":
    """Return the answer as a table, numbers to the right."""
    from dronecats.report.table import numbers, table_of, words

    cells = [[_shown(value) for value in row] for row in answer.rows]
    numeric = [_is_numeric(row[k] for row in answer.rows) for k in range(len(answer.columns))]
    columns = [numbers(name) if right else words(name) for name, right in zip(answer.columns, numeric, strict=True)]
    return table_of(columns, cells)


def _is_numeric(values: Iterable[Any]) -> bool:
    return all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values)


def _shown(value: Any) -> str | None:
    if value is None:
        return None
    if isinstance(value, float | Decimal):
        return f"{value:.6g}"
    return " ".join(str(value).split())


FORMATS = ("mcap", "rerun", "lerobot", "ulog", "kml", "geojson", "csv", "parquet")


def add_export_options(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's options."""
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="run folders, episodes of them, or folders that hold runs"
    )
    parser.add_argument("--to", required=True, choices=FORMATS, help="the format: docs/export.md says what opens it")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write into (default: RUN-FORMAT, here)")
    parser.add_argument("--overwrite", action="store_true", help="write anew what is there already")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=run_export)


def run_export(args: argparse.Namespace) -> int:
    """Write the files; status 0, episodes that are left out named on standard error."""
    from dronecats.report.export.formats import export
    from dronecats.report.recorded.run import recorded_runs

    out = args.out or Path(f"{args.runs[0].resolve().name}-{args.to}")
    done = export(args.to, recorded_runs(args.runs), out, args.overwrite)
    for said in done.left_out:
        print(f"dronecats export: left out: {said}", file=sys.stderr)
    if args.json:
        files = {str(path): count for path, count in done.files.items()}
        print(json.dumps({"to": args.to, "out": str(out), "files": files, "left_out": done.left_out}))
    else:
        for path, count in done.files.items():
            print(f"{path}  {count}")
    return 0
