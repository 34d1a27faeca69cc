"""Queries the tables of runs with SQL, in a read-only database in memory, and writes these tables to files.

Needs the extra `query`.
"""

import contextlib
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import duckdb
import numpy as np
from numpy.typing import NDArray

from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results import tables as tabulation
from dronecats.report.results.tables import TABLES
from foundation.errors import UsageError
from foundation.files import whole_file
from foundation.wording import did_you_mean, nearest, suggestion

# With these settings a query cannot read or write files, load code, see variables of this process, or change a setting
LOCKED = (
    "temp_directory = ''",
    "python_enable_replacements = false",
    "autoinstall_known_extensions = false",
    "autoload_known_extensions = false",
    "allow_community_extensions = false",
    "enable_external_access = false",
    "lock_configuration = true",
)
HEAD = re.compile(r"^(?:[\w ]+ Error: )?")  # the kind of error at the beginning of a DuckDB message
LEAST, GREATEST = -(2**63), 2**63 - 1
DTYPES: dict[str, Any] = {"BOOLEAN": np.bool_, "BIGINT": np.int64, "DOUBLE": np.float64}
TableFormat = Literal["csv", "parquet"]
AS: dict[TableFormat, str] = {"csv": "FORMAT csv, HEADER true", "parquet": "FORMAT parquet, COMPRESSION zstd"}
ColumnNames = Callable[[str, str], str]  # (table, column) → the column's name in the file


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryResult:
    columns: tuple[str, ...]  # unique names
    rows: list[tuple[Any, ...]]
    damage: tuple[str, ...]  # a sentence for each damaged episode in the tables that the query names


def query(sql: str, runs: Sequence[RecordedRun], parquet: Path | None = None) -> QueryResult:
    """Return the result of one SELECT. `parquet`: also write the result to this file, completely or not at all.

    The database has only the tables that the query names. Raises UsageError with the error in the SQL.
    """
    connection, damage = load(runs, tables_in_query(sql))
    with contextlib.closing(connection), whole_file(parquet) if parquet else contextlib.nullcontext() as draft:
        if draft is not None:  # the only file that the query may write
            connection.execute(f"SET allowed_paths = [{literal(str(draft))}]")
        for setting in LOCKED:
            connection.execute(f"SET {setting}")
        return _answer(connection, sql, draft, damage)


def tables_in_query(sql: str) -> list[str]:
    """Return the tables whose names occur in a query."""
    return [table for table in TABLES if re.search(rf"(?<!\w){table}(?!\w)", sql, re.IGNORECASE)]


def load(runs: Sequence[RecordedRun], wanted: Collection[str]) -> tuple[duckdb.DuckDBPyConnection, list[str]]:
    """Return a database in memory with the `wanted` tables of the runs, and a sentence for each damaged episode."""
    connection, damage = duckdb.connect(":memory:"), []
    for name in wanted:
        columns = ", ".join(f'"{c.name}" {c.type}' for c in TABLES[name].columns)
        connection.execute(f"CREATE TABLE {name} ({columns})")
    if not wanted:
        return connection, []
    for run, name in zip(runs, tabulation.names(runs), strict=True):
        tables, of_run = tabulation.tabulated(run, name, wanted)
        for table, values in tables.items():
            _insert(connection, table, values)
        damage += of_run
    return connection, damage


def literal(text: str) -> str:
    """Return a text as an SQL literal."""
    return "'" + text.replace("'", "''") + "'"


def _insert(connection: duckdb.DuckDBPyConnection, table: str, values: tabulation.Values) -> None:
    if not next(iter(values.values())):
        return
    incoming = {c.name: array(values[c.name], c.type) for c in TABLES[table].columns}
    connection.register("incoming", incoming)
    connection.execute(f"INSERT INTO {table} BY NAME SELECT * FROM incoming")
    connection.unregister("incoming")


def _answer(
    connection: duckdb.DuckDBPyConnection, sql: str, parquet: Path | None, damage: Sequence[str]
) -> QueryResult:
    if any("\ud800" <= letter <= "\udfff" for letter in sql):
        raise UsageError("the query is not UTF-8 text")
    try:
        statements = connection.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise UsageError("the query must be one SELECT, because queries are read-only")
        relation = connection.sql(sql)
        if parquet is not None:
            relation.write_parquet(str(parquet))
        return QueryResult(columns=_unique_names(relation.columns), rows=relation.fetchall(), damage=tuple(damage))
    except duckdb.Error as error:
        raise UsageError(f"the query cannot be answered: {sentence(str(error))}") from None


def sentence(message: str) -> str:
    """Return the first line of a database error and DuckDB's hint, if any, as one line.

    For an unknown table or column, the line suggests a similar name instead.
    """
    first, *more = [line.strip() for line in message.strip().splitlines()]
    first = HEAD.sub("", first, count=1)
    if table := re.match(r"Table with name (\S+) does not exist", first):
        return f"table '{table[1]}' does not exist: {suggestion(table[1], TABLES)} See: dronecats query --tables"
    if column := re.match(r'Referenced column "([^"]+)" not found', first):
        columns = dict.fromkeys(column.name for table in TABLES.values() for column in table.columns)
        hint = did_you_mean(near) + " " if (near := nearest(column[1], columns)) else ""
        return f"column '{column[1]}' does not exist: {hint}See: dronecats query --tables"
    hint = next((line for line in more if line.startswith(("Did you mean", "Candidate bindings"))), "")
    return f"{first.rstrip('!.')}; {hint}" if hint else first


def _unique_names(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names, with a number appended to each repetition."""
    unique: list[str] = []
    for name in columns:
        n = 2
        candidate = name
        while candidate in unique:
            candidate, n = f"{name}_{n}", n + 1
        unique.append(candidate)
    return tuple(unique)


def table_file(kind: TableFormat, table: str, out: Path) -> Path:
    """Return the path of a table in a folder."""
    return out / f"{table}.{kind}"


def write_tables(
    kind: TableFormat, runs: Sequence[RecordedRun], out: Path, column_name: ColumnNames = lambda table, column: column
) -> tuple[dict[str, int], list[str]]:
    """Write every table to a file in a folder. A missing folder is created. A file is written completely or not at all.

    Returns the number of rows of each table, and a sentence for each damaged episode. Raises UsageError when a file
    cannot be written.
    """
    connection, damage = load(runs, tuple(TABLES))
    try:
        out.mkdir(parents=True, exist_ok=True)
        rows = {name: _write(connection, kind, name, out, column_name) for name in TABLES}
    except (OSError, duckdb.Error) as error:
        reason = error.strerror or str(error) if isinstance(error, OSError) else sentence(str(error))
        raise UsageError(f"{out} cannot be written: {reason}. Choose another --out") from None
    finally:
        connection.close()
    return rows, damage


def _write(
    connection: duckdb.DuckDBPyConnection, kind: TableFormat, table: str, out: Path, column_name: ColumnNames
) -> int:
    path = table_file(kind, table, out)
    columns = ", ".join(f'"{c.name}" AS "{column_name(table, c.name)}"' for c in TABLES[table].columns)
    with whole_file(path) as draft:
        connection.execute(f"COPY (SELECT {columns} FROM {table}) TO {literal(str(draft))} ({AS[kind]})")
    counted = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
    return int(counted[0]) if counted else 0


def array(values: Sequence[Any], sql_type: str) -> NDArray[Any]:
    """Return values of one SQL type as an array. In arrays of numbers, None is masked; in arrays of texts, it stays.

    Integers that do not fit into 64 bits are replaced by None.
    """
    if sql_type not in DTYPES:
        texts = np.empty(len(values), dtype=object)
        texts[:] = [None if value is None else _text(value) for value in values]
        return texts
    if sql_type == "BIGINT":
        values = [None if value is None or not LEAST <= value <= GREATEST else value for value in values]
    mask = [value is None for value in values]
    filled = [0 if missing else value for missing, value in zip(mask, values, strict=True)]
    return np.ma.masked_array(np.array(filled, dtype=DTYPES[sql_type]), mask)


def _text(value: str) -> str:
    """Return a text with its lone surrogates escaped, because UTF-8 cannot encode them."""
    return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
