"""Verbs `query` and `export`: query runs with SQL, and convert them to other formats."""

import argparse
import csv
import io
import json
import math
from collections.abc import Iterable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dronecats.cli.output import print_note, show, write_data
from dronecats.report.table import ReportTable, numbers, table_of, words
from foundation.errors import UsageError
from foundation.files import file_errors_as, whole_file
from foundation.wording import counted

if TYPE_CHECKING:
    from dronecats.report.results.database import QueryResult

FORMATS = {"mcap": "message", "rerun": "message", "lerobot": "frame", "ulog": "message", "kml": "place",
           "geojson": "place", "csv": "row", "parquet": "row"}  # format → unit of the printed counts  # fmt: skip


def add_query_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("sql", nargs="?", metavar="SELECT", help="one SELECT, in quotes")
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN", help="runs, or folders of runs (default runs)")
    parser.add_argument("--tables", action="store_true", help="print the tables with their columns and units")
    parser.add_argument("--csv", metavar="FILE", help="write the answer as CSV; - is standard output")
    parser.add_argument("--parquet", type=Path, metavar="FILE", help="write the answer as Parquet")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_query)


def _query(args: argparse.Namespace) -> int:
    """Print or write the answer of a query. Prints the names of damaged episodes on standard error."""
    if args.tables:
        if args.csv is not None or args.parquet is not None:
            raise UsageError("--csv and --parquet write the answer of a query. Leave them out, or leave --tables out")
        if args.json:
            print(json.dumps({"tables": _tables_as_objects()}))
        else:
            show(*_run_tables())
        return 0
    if args.sql is None:
        raise UsageError('no query was given. Give one, such as "SELECT * FROM runs"; --tables prints the tables')
    if args.json and args.csv == "-":
        raise UsageError("--json and --csv - both write to standard output. Choose one")
    for file in (args.parquet, None if args.csv in (None, "-") else Path(args.csv)):
        if file is not None and not file.absolute().parent.is_dir():
            raise UsageError(f"folder {file.parent} of {file.name} does not exist. Create it first")
    answer = _answer(args)
    if args.csv is not None:
        _csv(answer, args.csv)
    if args.json:
        print(json.dumps({"rows": [_as_object(answer, row) for row in answer.rows], "damaged": [*answer.damage]}))
    elif args.csv is None and args.parquet is None:
        show(_table(answer))
    return 0


def _run_tables() -> list[ReportTable]:
    """Return a description of each database table, with a row per column."""
    from dronecats.report.results.tables import TABLES

    columns = (words("column"), words("type"), words("what"))
    return [
        replace(table_of(columns, ((c.name, c.type, c.description) for c in t.columns)), title=name, caption=t.about)
        for name, t in TABLES.items()
    ]


def _tables_as_objects() -> list[dict[str, Any]]:
    from dronecats.report.results.tables import TABLES

    return [
        {
            "name": name,
            "about": table.about,
            "columns": [{"name": c.name, "type": c.type, "description": c.description} for c in table.columns],
        }
        for name, table in TABLES.items()
    ]


def _answer(args: argparse.Namespace) -> "QueryResult":
    from dronecats.report.recorded.run import recorded_runs
    from dronecats.report.results.database import query

    with file_errors_as(UsageError, f"{args.parquet} cannot be written"):
        answer = query(args.sql, recorded_runs(args.runs or [Path("runs")]), args.parquet)
    for episode in answer.damage:
        print_note(f"dronecats query: damaged, and only in the table episodes: {episode}")
    return answer


def _csv(answer: "QueryResult", file: str) -> None:
    lines = [answer.columns, *([_cell(value) for value in row] for row in answer.rows)]
    if file == "-":
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(lines)
        write_data(text.getvalue())
        return
    path = Path(file)
    with (
        file_errors_as(UsageError, f"{file} cannot be written"),
        whole_file(path) as draft,
        draft.open("w", encoding="utf-8", newline="") as out,
    ):
        csv.writer(out, lineterminator="\n").writerows(lines)


def _cell(value: Any) -> Any:
    """Return a value as a CSV cell: lists, structs and booleans as JSON, null as an empty cell."""
    return json.dumps(_plain(value)) if isinstance(value, list | tuple | dict | bool) else value


def _as_object(answer: "QueryResult", row: Iterable[Any]) -> dict[str, Any]:
    return {name: _plain(value) for name, value in zip(answer.columns, row, strict=True)}


def _plain(value: Any) -> Any:
    """Return a value for JSON: NaN and infinity as null, types that JSON lacks as text."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Decimal):
        value = float(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _table(answer: "QueryResult") -> ReportTable:
    """Return the answer as a table. Numbers are aligned to the right."""
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


def add_export_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", type=Path, nargs="+", metavar="RUN", help="run folders, episodes of them, or folders that hold runs"
    )
    parser.add_argument("--to", required=True, choices=FORMATS, help="format; docs/export.md names programs for each")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the files (default RUN-FORMAT in this folder)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_export)


def _export(args: argparse.Namespace) -> int:
    """Write the files. Prints the names of episodes that are left out on standard error."""
    from dronecats.report.export.formats import export
    from dronecats.report.export.layouts import FILES
    from dronecats.report.recorded.run import recorded_runs

    out = args.out or Path(f"{args.runs[0].resolve().name}-{args.to}")
    done = export(args.to, recorded_runs(args.runs), out, args.overwrite)
    for episode in done.left_out:
        print_note(f"dronecats export: left out: {episode}")
    if args.json:
        files = {str(path): count for path, count in done.files.items()}
        print(json.dumps({"to": args.to, "out": str(out), "files": files, "left_out": done.left_out}))
    else:
        layouts = FILES.get(args.to, ())
        for path, count in done.files.items():
            print(f"{path}  {counted(count, 'panel' if path.name in layouts else FORMATS[args.to])}")
    return 0
