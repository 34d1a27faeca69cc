"""Runs in a database of this process, which SQL may read and nothing else, and their tables as files.

Needs the extra `query`.
"""

import contextlib
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import duckdb
import numpy as np
from numpy.typing import NDArray

from dronecats.report.recorded.run import RecordedRun
from dronecats.report.results import tabulation
from dronecats.report.results.tables import TABLES
from foundation.errors import UsageError
from foundation.files import whole_file

# What a query cannot do: read or write files, load code, see this process's variables, change these settings
LOCKED = (
    "temp_directory = ''",
    "python_enable_replacements = false",
    "autoinstall_known_extensions = false",
    "autoload_known_extensions = false",
    "allow_community_extensions = false",
    "enable_external_access = false",
    "lock_configuration = true",
)
HEAD = re.compile(r"^(?:[\w ]+ Error: )?")  # the kind of an error, as the database names it
LEAST, GREATEST = -(2**63), 2**63 - 1
DTYPES: dict[str, Any] = {"BOOLEAN": np.bool_, "BIGINT": np.int64, "DOUBLE": np.float64}
TableFormat = Literal["csv", "parquet"]
AS: dict[TableFormat, str] = {"csv": "FORMAT csv, HEADER true", "parquet": "FORMAT parquet, COMPRESSION zstd"}
ColumnNames = Callable[[str, str], str]  # of a table and its column: what that is called in the file


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """What a query came to."""

    columns: tuple[str, ...]  # each name once
    rows: list[tuple[Any, ...]]
    damage: tuple[str, ...]  # damaged episodes of the tables that were read, a sentence each


@dataclass(slots=True)
class Loaded:
    """Tables of runs in a database."""

    connection: duckdb.DuckDBPyConnection
    damage: list[str] = field(default_factory=list)


def query(sql: str, runs: Sequence[RecordedRun], parquet: Path | None = None) -> Selected:
    """Return what one SELECT says of the runs; with `parquet` it is written there, too, whole or not at all.

    Only the tables that the text names are read, and exist. Raises UsageError with what is wrong in the SQL.
    """
    loaded = load(runs, named(sql))
    with contextlib.closing(loaded.connection), whole_file(parquet) if parquet else contextlib.nullcontext() as draft:
        if draft is not None:  # the only file that there is for it
            loaded.connection.execute(f"SET allowed_paths = [{literal(str(draft))}]")
        for setting in LOCKED:
            loaded.connection.execute(f"SET {setting}")
        return _answer(loaded, sql, draft)


def named(sql: str) -> list[str]:
    """Return the tables whose names occur in a text, wherever: what does not occur cannot be asked for."""
    return [table for table in TABLES if re.search(rf"(?<!\w){table}(?!\w)", sql, re.IGNORECASE)]


def load(runs: Sequence[RecordedRun], wanted: Collection[str]) -> Loaded:
    """Return a database in memory with these tables, all else of the runs unread."""
    loaded = Loaded(duckdb.connect(":memory:"))
    for name in wanted:
        columns = ", ".join(f'"{c.name}" {c.type}' for c in TABLES[name].columns)
        loaded.connection.execute(f"CREATE TABLE {name} ({columns})")
    if not wanted:
        return loaded
    for run, name in zip(runs, tabulation.names(runs), strict=True):
        told = tabulation.tabulated(run, name, wanted)
        for table, values in told.tables.items():
            _insert(loaded.connection, table, values)
        loaded.damage += told.damage
    return loaded


def literal(text: str) -> str:
    """Return a text as SQL has it."""
    return "'" + text.replace("'", "''") + "'"


def _insert(connection: duckdb.DuckDBPyConnection, table: str, values: tabulation.Values) -> None:
    if not next(iter(values.values())):
        return
    incoming = {c.name: array(values[c.name], c.type) for c in TABLES[table].columns}
    connection.register("incoming", incoming)
    connection.execute(f"INSERT INTO {table} BY NAME SELECT * FROM incoming")
    connection.unregister("incoming")


def _answer(loaded: Loaded, sql: str, parquet: Path | None) -> Selected:
    if any("\ud800" <= letter <= "\udfff" for letter in sql):
        raise UsageError("the query cannot be answered: it is no text in UTF-8")
    try:
        statements = loaded.connection.extract_statements(sql)
        if len(statements) != 1 or statements[0].type != duckdb.StatementType.SELECT:
            raise UsageError("a query is one SELECT; it changes nothing and writes nothing")
        found = loaded.connection.sql(sql)
        if parquet is not None:
            found.write_parquet(str(parquet))
        return Selected(columns=_each_once(found.columns), rows=found.fetchall(), damage=tuple(loaded.damage))
    except duckdb.Error as error:
        raise UsageError(f"the query cannot be answered: {sentence(str(error))}") from None


def sentence(said: str) -> str:
    """Return the first sentence of an error of the database, and what it would take instead, on one line."""
    first, *more = [line.strip() for line in said.strip().splitlines()]
    first = HEAD.sub("", first, count=1)
    hint = next((line for line in more if line.startswith(("Did you mean", "Candidate bindings"))), "")
    if re.match(r"Table with name \S+ does not exist", first):
        hint = f"the tables are {', '.join(TABLES)}"
    return f"{first.rstrip('!.')}; {hint}" if hint else first


def _each_once(columns: Sequence[str]) -> tuple[str, ...]:
    """Return the names with a number after those that occur again."""
    told: list[str] = []
    for name in columns:
        n = 2
        once = name
        while once in told:
            once, n = f"{name}_{n}", n + 1
        told.append(once)
    return tuple(told)


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


def array(values: Sequence[Any], sql_type: str) -> NDArray[Any]:
    """Return values of one SQL type as an array; where a value is None it is masked, of text None itself.

    What no column of that type can hold, a whole number beyond 64 bits, is None.
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
    """Return a text with what UTF-8 has no bytes for, half a surrogate pair, escaped."""
    return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
