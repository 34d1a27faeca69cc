"""Tests CSV and Parquet exports: they have the rows of SQL, and every column of the judge is marked."""

import csv

import duckdb
import pytest

from dronecats.report.export import formats
from dronecats.report.results.database import query
from dronecats.report.results.tables import TABLES


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_the_files_hold_the_rows_of_the_query(kind, run, tmp_path):
    done = formats.export(kind, [run], tmp_path / "out")
    assert done.left_out == []
    for name, path in zip(TABLES, done.files, strict=True):
        result = query(f"SELECT * FROM {name}", [run])
        reader = "read_csv(?, all_varchar=false)" if kind == "csv" else "read_parquet(?)"
        with duckdb.connect() as connection:
            answer = connection.execute(f"SELECT * FROM {reader}", [str(path)])
            columns, exported_rows = [column_info[0] for column_info in answer.description], answer.fetchall()
        assert len(result.rows) == done.files[path]
        assert [column.removeprefix("judge/") for column in columns] == [*result.columns]
        if kind == "parquet":
            assert exported_rows == result.rows
        else:  # CSV has no types, and no difference between null and empty text
            empty = [[value in (None, "") for value in row] for row in result.rows]
            assert [[value is None for value in row] for row in exported_rows] == empty


def test_csv_is_readable_by_a_generic_csv_reader(run, tmp_path):
    formats.export("csv", [run], tmp_path)
    with (tmp_path / "steps.csv").open(newline="") as file:
        records = list(csv.DictReader(file))
    decisions = query("SELECT episode, drone_index, t_decided_s, reply, north_m FROM steps", [run]).rows
    assert [
        (
            record["episode"],
            int(record["drone_index"]),
            float(record["t_decided_s"]),
            record["reply"],
            float(record["judge/north_m"]),
        )
        for record in records
    ] == decisions


def test_columns_of_the_judge_are_marked():
    """The marked columns have positions, targets, distances, visibility and verdicts."""
    true = {"north_m", "east_m", "down_m", "yaw_deg", "target_north_m", "target_east_m", "target_down_m", "distance_m",
            "distance_box_m", "visible", "visible_fraction", "bearing_deg", "oracle_depth_m", "success", "outcome",
            "oracle_success", "ne_m", "qualifies", "scored", "min_distance_m", "on_target", "path_m"}  # fmt: skip
    for name, table in TABLES.items():
        for column in table.columns:
            if column.name in true:
                assert formats.column_name(name, column.name) == f"judge/{column.name}"
        assert formats.OPEN[name] <= {column.name for column in table.columns}
