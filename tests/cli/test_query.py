"""The commands `dronecats query` and `dronecats bench export-parquet`."""

import csv
import io
import json
import re
import subprocess

import pytest

from dronecats.cli.main import main
from tests.report.results.synthetic_runs import write_run
from tests.support.command_line import DRONECATS

SQL = "SELECT episode, success, ne_m, [1, 2] AS list, 'nan'::DOUBLE AS nan, NULL AS none FROM episodes ORDER BY ALL"


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "runs" / "oracle", ("campus-searching-01", "residential-approaching-01"))
    return tmp_path


def test_query_reads_the_folder_runs_and_prints_a_table(place, capsys):
    assert main(["query", SQL]) == 0
    head, _, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["episode", "success", "ne_m", "list", "nan", "none"]
    assert rows[0].split() == ["campus-searching-01", "True", "1.5", "[1,", "2]", "nan", "–"]


def test_json_is_one_object(place, capsys):
    assert main(["query", SQL, "runs/oracle", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["damaged"] == []
    assert result["rows"][0] == {
        "episode": "campus-searching-01", "success": True, "ne_m": 1.5, "list": [1, 2], "nan": None, "none": None,
    }  # fmt: skip


def test_csv_is_written_to_a_file_or_to_standard_output(place, capsys):
    assert main(["query", SQL, "--csv", "-"]) == 0
    printed = capsys.readouterr().out
    assert main(["query", SQL, "--csv", "answer.csv"]) == 0
    assert capsys.readouterr().out == ""
    assert (place / "answer.csv").read_text() == printed
    assert list(csv.reader(io.StringIO(printed)))[1] == ["campus-searching-01", "true", "1.5", "[1, 2]", "nan", ""]


def test_a_pipe_gets_the_same_bytes_as_a_csv_file(place):
    sql = "SELECT 'a' || chr(9) || 'b' AS x"
    command = [*DRONECATS, "query", sql, "--csv"]
    printed = subprocess.run([*command, "-"], stdout=subprocess.PIPE, timeout=300, check=True).stdout
    assert main(["query", sql, "--csv", "answer.csv"]) == 0
    assert (place / "answer.csv").read_bytes() == printed == b"x\na\tb\n"


def test_parquet_is_written_to_a_file(place, capsys):
    assert main(["query", SQL, "--parquet", "answer.parquet"]) == 0
    assert capsys.readouterr().out == ""
    assert (place / "answer.parquet").read_bytes()[:4] == b"PAR1"


def test_damage_is_reported_on_standard_error(place, capsys):
    (place / "runs" / "oracle" / "campus-searching-01" / "truth.jsonl").write_text("[]\n")
    assert main(["query", "SELECT count(*) AS n FROM steps"]) == 0
    captured = capsys.readouterr()
    assert captured.out.split()[-1] == "5"
    assert "truth.jsonl line 1 " in captured.err


def test_the_tables_are_listed_without_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["query", "--tables"]) == 0
    assert re.search(r"\bne_m +DOUBLE ", capsys.readouterr().out)
    assert main(["query", "--tables", "--json"]) == 0
    tables = {table["name"]: table["columns"] for table in json.loads(capsys.readouterr().out)["tables"]}
    assert ("ne_m", "DOUBLE") in [(column["name"], column["type"]) for column in tables["episodes"]]


def test_wrong_usage_is_one_sentence(place, capsys):
    for arguments, parts in (
        (["query"], "--tables"),
        (["query", "SELECT 1", "nowhere"], "nowhere"),
        (["query", "SELECT 1", "--csv", "no/where.csv"], r"folder no\b"),
        (["query", "SELECT 1", "--parquet", "no/where"], r"folder no\b"),
        (["query", "SELECT 1", "--parquet", "runs"], r"\bruns\b"),
        (["query", "SELECT 1", "--csv", "runs"], r"\bruns\b"),
        (["query", "SELECT 1", "--csv", "-", "--json"], "--json"),
        (["query", "SELEC"], "SELEC"),
        (["query", "--tables", "--csv", "-"], "--tables"),
        (["query", "--tables", "--parquet", "answer.parquet"], "--tables"),
    ):
        assert main(arguments) == 2, arguments
        error = capsys.readouterr().err.strip()
        assert re.search(parts, error), error
        assert len(error.splitlines()) == 1, arguments


def test_bench_export_parquet_writes_the_tables(place, capsys):
    assert main(["bench", "export-parquet", "runs", "--out", "out", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"]["episodes"] == 2
    assert len(list((place / "out").glob("*.parquet"))) == 5
    assert main(["bench", "export-parquet", "runs"]) == 2
    assert "--out DIR" in capsys.readouterr().err
