"""Tests SQL over run folders: the results, the files that a query reads, and the statements that are rejected."""

import json
import re
from pathlib import Path

import duckdb
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dronecats.judge.metrics.judging import METRICS
from dronecats.report.recorded.flight import RecordedFlight
from dronecats.report.recorded.run import recorded_runs
from dronecats.report.results import database
from dronecats.report.results.database import QueryResult, array, query, tables_in_query, write_tables
from dronecats.report.results.tables import TABLES, markdown
from foundation.errors import UsageError
from tests.docs.pages import ROOT
from tests.report.results.synthetic_runs import clear, hit, reset, tell_incidents, write_run

EPISODES = ("residential-approaching-01", "blocks-commanding-01")
PAGE = (ROOT / "docs" / "query.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```sql\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("query") / "runs"
    write_run(folder / "oracle", EPISODES)
    write_run(folder / "silent", EPISODES, pilot="failing:never-declares")
    return Path(folder)


def ask(sql: str, runs: Path, parquet: Path | None = None) -> list[dict[str, object]]:
    answer = query(sql, recorded_runs([runs]), parquet)
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def test_hits_and_resets_are_columns_of_episodes(tmp_path):
    run = write_run(tmp_path / "runs" / "oracle", EPISODES)
    tell_incidents(run / EPISODES[0], hit(2.0), hit(3.0, "fence", 0.4), clear(6.0, 3.5), hit(7.0, "fence", 2.5, True),
                   clear(9.0, 0.5), reset(4.0, 2))  # fmt: skip
    columns = "hits, crashes, hardest_hit_mps, contact_s, estimator_resets"
    rows = ask(f"SELECT {columns} FROM episodes ORDER BY episode DESC", tmp_path / "runs")
    assert [tuple(row.values()) for row in rows] == [(3, 1, 2.5, 4.0, 2), (None,) * 5]


def test_the_tables_match_the_logs(runs):
    logs = RecordedFlight.read(runs / "oracle" / EPISODES[1]).logs
    where = f"run = 'oracle' AND episode = '{EPISODES[1]}'"
    steps = ask(f"SELECT * FROM steps WHERE {where}", runs)
    assert [(s["drone_index"], s["step"], s["frame_id"], s["reply"]) for s in steps] == [
        (d.drone, d.step, d.frame_id, d.reply) for d in logs.decisions
    ]
    assert [s["distance_m"] for s in steps] == [logs.frames[d.drone, d.frame_id].distance_m for d in logs.decisions]
    assert {(s["action"], s["point_x"], s["depth_m"]) for s in steps} == {("go", 500.0, 12.5), ("finished", None, None)}
    poses = ask(f"SELECT * FROM poses WHERE {where}", runs)
    assert [(p["t_s"], p["north_m"], p["target_down_m"]) for p in poses] == [
        (p.t, p.position_ned[0], p.target_ned and p.target_ned[2]) for p in logs.poses
    ]
    [declared] = ask(f"SELECT * FROM declarations WHERE {where}", runs)
    fields = {name: declared[name] for name in ("number", "drone_index", "counts", "qualifies")}
    assert fields == {"number": 1, "drone_index": 0, "counts": True, "qualifies": True}
    [run] = ask("SELECT * FROM runs WHERE run = 'silent'", runs)
    assert (run["pilot"], run["is_model"], run["episodes"]) == ("failing:never-declares", False, 2)
    assert json.loads(str(run["configuration"]))["flight"]["pilot"] == "failing:never-declares"


def test_latency_and_tokens_of_a_joint_reply_count_once_for_the_first_drone(runs):
    flight = RecordedFlight.read(runs / "oracle" / EPISODES[1])
    steps = ask(f"SELECT * FROM steps WHERE run = 'oracle' AND episode = '{EPISODES[1]}'", runs)
    assert [(s["latency_s"], s["tokens_in"]) for s in steps] == [
        (None, None) if s["drone_index"] else (0.5, 900) for s in steps
    ]
    for metric in TABLES["steps"].metrics:
        assert [s[metric.name] for s in steps] == metric.of(flight), metric.name


def test_no_column_hides_a_metric():
    for table in TABLES.values():
        assert not {column.name for column in table.own} & {m.name for m in METRICS.values() if m.level == table.level}


def test_episode_rows_have_the_verdict_and_every_metric(runs):
    episode_rows = ask("SELECT * FROM episodes ORDER BY run, episode", runs)
    assert [(e["run"], e["success"], e["outcome"]) for e in episode_rows] == [
        ("oracle", True, "success"), ("oracle", True, "success"),
        ("silent", False, "failure"), ("silent", False, "failure"),
    ]  # fmt: skip
    flight = RecordedFlight.read(runs / "oracle" / EPISODES[1])
    for metric in TABLES["episodes"].metrics:
        value = metric.of(flight)
        assert episode_rows[0][metric.name] == value, metric.name
        assert isinstance(value, bool) == isinstance(episode_rows[0][metric.name], bool), metric.name


def test_a_damaged_episode_has_its_error_in_its_row_and_others_are_unaffected(tmp_path):
    run = write_run(tmp_path / "run", EPISODES)
    log = run / EPISODES[0] / "truth.jsonl"
    log.write_text(log.read_text().replace('"t": 0.0', '"t": "x"', 1))
    sql = "SELECT episode, scored, error, outcome FROM episodes ORDER BY scored"
    answer = query(sql, recorded_runs([run]))
    assert answer.rows[0][:2] == (EPISODES[0], False)
    assert re.search(r"\b1\b", answer.rows[0][2])
    assert answer.rows[1] == (EPISODES[1], True, None, "success")
    assert len(answer.damage) == 1
    assert query("SELECT DISTINCT episode FROM poses", recorded_runs([run])).damage == answer.damage


def test_a_query_reads_only_the_tables_that_it_names(runs, monkeypatch):
    monkeypatch.setattr(RecordedFlight, "read", lambda folder: pytest.fail("an episode was read"))
    assert ask("SELECT count(*) AS n FROM RUNS", runs) == [{"n": 2}]
    assert ask("SELECT 1 AS one", runs) == [{"one": 1}]


def test_a_table_name_that_sql_composes_is_rejected(runs):
    """If it were accepted, the table would be empty."""
    with pytest.raises(UsageError, match="steps"):
        ask("SELECT * FROM query_table('st' || 'eps')", runs)


def test_table_names_match_whole_words():
    assert sorted(tables_in_query("SELECT * FROM steps")) == ["steps"]
    assert sorted(tables_in_query('select * from "Steps" s join EPISODES using (run)')) == ["episodes", "steps"]
    assert sorted(tables_in_query("SELECT steps_ FROM x_poses")) == []


def test_the_examples_run_and_most_return_rows(runs):
    answers = [query(example, recorded_runs([runs])) for example in EXAMPLES]
    assert all(answer.columns for answer in answers)
    assert (
        sum(bool(answer.rows) for answer in answers) >= 8
    )  # no flight here is unscored, and no declaration is at the wrong place


def test_the_docs_page_lists_the_current_tables():
    """The page lists all columns except those of metrics."""
    assert "### runs" + PAGE.partition("### runs")[2] == markdown()


def test_descriptions_of_measured_columns_begin_with_the_unit():
    units = {"_m": "m", "_s": "s", "_deg": "°", "_hz": "Hz"}
    for table in TABLES.values():
        for column in table.columns:
            unit = next((unit for end, unit in units.items() if column.name.endswith(end)), "")
            assert column.description.startswith(unit), f"{table.name}.{column.name}"


def test_a_query_is_one_select(runs, tmp_path):
    for sql in (
        "COPY runs TO '{out}'",
        "EXPLAIN ANALYZE COPY runs TO '{out}'",
        "EXPORT DATABASE '{out}'",
        "ATTACH '{out}'",
        "INSTALL httpfs",
        "LOAD httpfs",
        "SET enable_external_access = true",
        "RESET lock_configuration",
        "PRAGMA enable_profiling",
        "CREATE TABLE mine AS SELECT 1",
        "INSERT INTO runs SELECT * FROM runs",
        "DROP TABLE runs",
        "SELECT 1; COPY runs TO '{out}'",
        "",
        "-- nothing",
    ):
        with pytest.raises(UsageError, match="SELECT"):
            ask(sql.format(out=tmp_path / "out"), runs)
        assert list(tmp_path.iterdir()) == [], sql


def test_a_select_reads_nothing_but_its_tables(runs, tmp_path):
    file = tmp_path / "secret.csv"
    file.write_text("a\n1\n")
    planted = {"a": np.array([1.0])}  # a variable of this process that the database could scan
    assert planted
    for sql in (
        "SELECT * FROM read_text('{file}')",
        "SELECT * FROM read_csv('{file}')",
        "SELECT * FROM read_blob('{file}')",
        "SELECT * FROM '{file}'",
        "SELECT * FROM glob('{file}*')",
        "SELECT * FROM read_csv('https://example.org/x.csv')",
        "SELECT * FROM query('COPY runs TO ''{file}.out''')",
        "SELECT getenv('PATH')",
        "SELECT * FROM planted",
    ):
        with pytest.raises(UsageError):
            ask(sql.format(file=file), runs, parquet=tmp_path / "answer.parquet")
        assert [path.name for path in tmp_path.iterdir()] == ["secret.csv"], sql


def test_locked_settings_alone_reject_other_statements(runs):
    """Statements other than SELECT are rejected before they run. The database would also reject them."""
    connection, _ = database.load(recorded_runs([runs]), ["runs"])
    for setting in database.LOCKED:
        connection.execute(f"SET {setting}")
    for sql in ("COPY runs TO 'x'", "INSTALL httpfs", "LOAD httpfs", "ATTACH 'x'", "SET threads = 1"):
        with pytest.raises(duckdb.Error):
            connection.execute(sql)
    connection.close()


def test_a_query_runs_with_all_locked_settings(runs):
    expected = dict(setting.split(" = ") for setting in database.LOCKED)
    setting_rows = ask("SELECT name, value FROM duckdb_settings()", runs)
    active = {row["name"]: row["value"] for row in setting_rows if row["name"] in expected}
    assert active == {
        "enable_external_access": "false", "lock_configuration": "true", "python_enable_replacements": "false",
        "autoinstall_known_extensions": "false", "autoload_known_extensions": "false",
        "allow_community_extensions": "false", "temp_directory": "",
    }  # fmt: skip


def test_errors_are_one_sentence(runs):
    for sql, part in (
        ("SELEC 1", "SELEC"),
        ("SELECT * FROM flights", "'flights'"),
        ("SELECT nem FROM episodes", "'ne_m'"),
        ("SELECT 'x'::INT", "'x'"),
        ("SELECT '\udce9'", "UTF-8"),
    ):
        with pytest.raises(UsageError, match=re.escape(part)) as wrong:
            ask(sql, runs)
        assert len(str(wrong.value).splitlines()) == 1, part


def test_an_answer_is_written_as_parquet(runs, tmp_path):
    file = tmp_path / "it's.parquet"
    rows = ask("SELECT run, episode, ne_m FROM episodes ORDER BY ALL", runs, parquet=file)
    parquet_rows = duckdb.connect().execute("SELECT * FROM read_parquet(?)", [str(file)]).fetchall()
    assert [tuple(row.values()) for row in rows] == parquet_rows
    assert [path.name for path in tmp_path.iterdir()] == ["it's.parquet"]


def test_an_export_writes_one_file_per_table(runs, tmp_path):
    rows, damage = write_tables("parquet", recorded_runs([runs]), tmp_path / "out")
    assert damage == []
    assert rows == {"runs": 2, "episodes": 4, "steps": 50, "poses": 490, "declarations": 2}
    for table in TABLES.values():
        description = (
            duckdb.connect().execute(f"DESCRIBE SELECT * FROM '{tmp_path}/out/{table.name}.parquet'").fetchall()
        )
        assert [(name, kind) for name, kind, *_ in description] == [(c.name, c.type) for c in table.columns]
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="/file"):
        write_tables("parquet", recorded_runs([runs]), tmp_path / "file")


def test_runs_with_one_name_get_different_labels(tmp_path):
    for which in ("a", "b"):
        write_run(tmp_path / which / "oracle", EPISODES[:1])
    same_named = recorded_runs([tmp_path / "a", tmp_path / "b"])
    assert [row[0] for row in query("SELECT run FROM runs", same_named).rows] == ["a/oracle", "b/oracle"]


def test_columns_with_one_name_get_different_labels(runs):
    answer = query("SELECT 1 AS a, 2 AS a, 3 AS a_2, 4 AS a FROM runs", recorded_runs([runs]))
    assert isinstance(answer, QueryResult)
    assert answer.columns == ("a", "a_2", "a_2_2", "a_3")


@given(st.lists(st.one_of(st.none(), st.integers())))
def test_integers_are_unchanged_and_those_beyond_64_bits_are_null(values):
    result = array(values, "BIGINT").tolist()
    assert result == [v if v is not None and -(2**63) <= v < 2**63 else None for v in values]


@pytest.fixture(scope="module")
def connection():
    with duckdb.connect(":memory:") as opened:
        yield opened


@settings(max_examples=50)
@given(values=st.lists(st.one_of(st.none(), st.text(), st.text(st.characters(categories=("L", "Cs"))))))
def test_texts_are_unchanged_in_the_database(values, connection):
    """Half a surrogate pair is valid in JSON and not in UTF-8. It is escaped."""
    connection.execute("CREATE OR REPLACE TABLE t (n BIGINT, x VARCHAR)")
    connection.register("incoming", {"n": np.arange(len(values)), "x": array(values, "VARCHAR")})
    if values:
        connection.execute("INSERT INTO t SELECT * FROM incoming")
    results = [row[0] for row in connection.execute("SELECT x FROM t ORDER BY n").fetchall()]
    assert results == [v if v is None else v.encode("utf-8", "backslashreplace").decode() for v in values]
