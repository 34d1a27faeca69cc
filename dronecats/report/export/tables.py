"""The tables of docs/query.md as CSV or Parquet files, one a table. Needs the extra `query`.

What the judge knows and the agent did not is in columns whose names begin with `judge/`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dronecats.report.export.naming import JUDGE
from dronecats.report.results.flown_run import FlownRun
from dronecats.report.results.table_files import TableFormat, table_file, write_tables
from dronecats.report.results.tables import TABLES

OF_EPISODE = frozenset({"run", "episode", "map", "cell", "instruction", "drones", "ended", "ended_s"})
COSTS = frozenset({"questions", "median_latency_s", "rate_hz_5", "rate_hz_50", "rate_hz_95", "all_tokens_in",
                   "all_tokens_out", "decisions", "unreadable", "refused", "cut_off"})  # fmt: skip
OF_STEP = frozenset({"run", "episode", "drone_index", "step", "frame_id", "t_frame_s", "t_decided_s", "action",
                     "point_x", "point_y", "depth_m", "angle_deg", "reply", "error", "mended", "latency_s", "tokens_in",
                     "tokens_out", "thinking", "rate_hz", "finish", "rescaled", "wide_rotation"})  # fmt: skip
# table → columns that anybody could know who had flown the drone; all others of these tables are the judge's
OPEN: Mapping[str, frozenset[str]] = {
    "runs": frozenset(column.name for column in TABLES["runs"].columns),
    "episodes": OF_EPISODE | COSTS | {"wide_rotations"},
    "steps": OF_STEP,
    "poses": frozenset({"run", "episode", "drone_index", "t_s"}),
    "declarations": frozenset({"run", "episode", "number", "drone_index", "step", "t_s", "counts"}),
}


def column_name(table: str, column: str) -> str:
    """Return what a column of a table is called in the files."""
    return column if column in OPEN[table] else f"{JUDGE}/{column}"


def files(kind: TableFormat, out: Path) -> list[Path]:
    """Return the files that an export into a folder consists of."""
    return [table_file(kind, table, out) for table in TABLES]


def write(kind: TableFormat, runs: Sequence[FlownRun], out: Path) -> tuple[dict[Path, int], list[str]]:
    """Write every table into a folder, as `write_tables`; return the rows of each file, and what was damaged."""
    rows, damage = write_tables(kind, runs, out, column_name)
    return {table_file(kind, table, out): count for table, count in rows.items()}, damage
