"""Runs as files of a kind that others read, one a table. Needs the extra `query`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import duckdb

from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results.database import literal, load, sentence
from dronecats.report.results.tables import TABLES
from foundation.errors import UsageError
from foundation.whole_file import whole_file

TableFormat = Literal["csv", "parquet"]
AS: dict[TableFormat, str] = {"csv": "FORMAT csv, HEADER true", "parquet": "FORMAT parquet, COMPRESSION zstd"}
ColumnNames = Callable[[str, str], str]  # of a table and its column: what that is called in the file


def table_file(kind: TableFormat, table: str, out: Path) -> Path:
    """Return where a table is written in a folder."""
    return out / f"{table}.{kind}"


def write_tables(
    kind: TableFormat, runs: Sequence[RecordedRun], out: Path, called: ColumnNames = lambda table, column: column
) -> tuple[dict[str, int], list[str]]:
    """Write every table into a folder, which is made where it is missing.

    Returns the rows of each table and what was damaged, a sentence an episode. A file is there whole or not at all.
    Raises UsageError when it cannot be written.
    """
    loaded = load(runs, tuple(TABLES))
    try:
        out.mkdir(parents=True, exist_ok=True)
        rows = {name: _write(loaded.connection, kind, name, out, called) for name in TABLES}
    except (OSError, duckdb.Error) as error:
        said = error.strerror or str(error) if isinstance(error, OSError) else sentence(str(error))
        raise UsageError(f"{out} cannot be written: {said}; choose another --out") from None
    finally:
        loaded.connection.close()
    return rows, loaded.damage


def _write(connection: duckdb.DuckDBPyConnection, kind: TableFormat, table: str, out: Path, called: ColumnNames) -> int:
    path = table_file(kind, table, out)
    columns = ", ".join(f'"{c.name}" AS "{called(table, c.name)}"' for c in TABLES[table].columns)
    with whole_file(path) as draft:
        connection.execute(f"COPY (SELECT {columns} FROM {table}) TO {literal(str(draft))} ({AS[kind]})")
    counted = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
    return int(counted[0]) if counted else 0
