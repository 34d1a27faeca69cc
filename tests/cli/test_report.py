"""The command `dronecats report`, on run folders on disk."""

import csv
import json
import re
import shutil

import pytest

from dronecats.cli.main import main
from dronecats.report import figures as drawing
from dronecats.report.report_data import BLIND_ROW_TITLE
from tests.report.results.synthetic_runs import clear, hit, reset, tell_incidents, write_run
from tests.support.command_line import last_object

DRAW = drawing.draw
IDS = ("campus-searching-01", "residential-approaching-01", "residential-approaching-02")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return a folder of two runs and disable the figures of reports, which take most of the time."""
    monkeypatch.setattr(drawing, "draw", lambda data, made, out: {})
    monkeypatch.chdir(tmp_path)
    write_run(tmp_path / "runs" / "oracle", IDS)
    write_run(tmp_path / "runs" / "silent", IDS, pilot="failing:never-declares")
    return tmp_path


def rates(out):
    with (out / "tables" / "main.csv").open(encoding="utf-8", newline="") as file:
        return {row["pilot"]: row["approaching_success_percent"] for row in csv.DictReader(file) if row["block"]}


def test_a_folder_of_runs_becomes_tables_and_figures(place, capsys, monkeypatch):
    monkeypatch.setattr(drawing, "draw", DRAW)
    assert main(["report", "runs", "--out", "report", "--no-page"]) == 0
    printed = capsys.readouterr().out
    assert printed.endswith(" report/report.md\n")
    assert rates(place / "report") == {"oracle": "100.0", "failing:never-declares": "0.0"}
    text = (place / "report" / "report.md").read_text(encoding="utf-8")
    assert "dronecats report runs --out report\n" in text
    assert re.search(r"\b6 flights .*\b3 episodes.*\b6 .*scored", text)
    for figure in ("reach_declare_succeed", "failure_modes", "episode_by_episode"):
        assert f"(figures/{figure}.png)" in text
        assert all((place / "report" / "figures" / f"{figure}.{kind}").exists() for kind in ("svg", "pdf", "png"))


def test_json_output_contains_the_tables(place, capsys):
    assert main(["report", "runs/oracle", "runs/silent", "--out", "report", "--no-page", "--json"]) == 0
    result = last_object(capsys.readouterr().out)
    assert result["report"] == "report/report.md"
    assert result["page"] is None
    assert [row["arrived_percent"] for row in result["tables"]["failures"]] == [0.0, 100.0]
    assert len({row["block"] for row in result["tables"]["failures"]}) == 1


def test_the_html_page_is_written_next_to_the_report(place, capsys, monkeypatch):
    monkeypatch.setattr("dronecats.report.page.pictures.GROUND_PX", 100)
    assert main(["report", "runs/oracle", "--out", "report"]) == 0
    assert re.search(r"report/report\.md\b.* report/index\.html\n$", capsys.readouterr().out)
    assert (place / "report" / "index.html").exists()


def test_a_report_without_a_page_removes_the_page_of_an_earlier_report(place, monkeypatch):
    monkeypatch.setattr("dronecats.report.page.pictures.GROUND_PX", 100)
    report, frames = place / "report", place / "runs" / "oracle" / IDS[0] / "frames"
    run = frames.parents[1] / "run.json"
    run.write_text(run.read_text().replace('"rendered": false', '"rendered": true'))
    frames.mkdir()
    (frames / "000000.jpg").touch()
    assert main(["report", "runs", "--out", "report"]) == 0
    assert [path.name for path in (report / "pictures").rglob("*")] == ["oracle", IDS[0], "000000.jpg"]
    script = report / "data" / "site" / "app.js"  # of the user
    script.parent.mkdir()
    script.touch()
    assert main(["report", "runs/oracle", "--out", "report", "--no-page"]) == 0
    assert not (report / "index.html").exists()
    assert not (report / "pictures").exists()
    assert [*(report / "data").rglob("*")] == [script.parent, script]
    (report / "index.html").mkdir()
    assert main(["report", "runs/oracle", "--out", "report", "--no-page"]) == 3


@pytest.mark.parametrize("metric", ["hits", "estimator_resets"])
def test_incidents_have_a_table_and_their_flights_can_be_excluded(place, metric):
    tell_incidents(place / "runs" / "oracle" / IDS[0], hit(2.0), hit(8.0), clear(10.0, 1.5), reset(4.0))
    tell_incidents(place / "runs" / "oracle" / IDS[1])
    command = ["report", "runs/oracle", "--out", "report", "--no-page"]
    assert main(command) == 0
    with (place / "report" / "tables" / "incidents.csv").open(encoding="utf-8", newline="") as file:
        [row] = csv.DictReader(file)
    assert [row[k] for k in ("flights", "hits", "contact_s", "estimator_resets")] == ["3", "2", "1.5", "1"]
    assert (
        row["hit_flights_percent"] == row["reset_flights_percent"] == "50.0"
    )  # of the two flights with a record of incidents
    assert main([*command, "--exclude-above", f"{metric}=0"]) == 0
    with (place / "report" / "tables" / "main.csv").open(encoding="utf-8", newline="") as file:
        [row] = [row for row in csv.DictReader(file) if row["pilot"] == "oracle"]
    assert (row["flights"], row["not_scored"]) == ("2", "1")
    page = (place / "report" / "report.md").read_text(encoding="utf-8")
    assert f"1 of 3 flights: {metric} above 0" in page.replace("\\", "")


def test_delta_recomputes_the_verdicts_and_is_printed(place):
    assert main(["report", "runs", "--out", "report", "--no-page", "--delta", "0.5"]) == 0
    assert set(rates(place / "report").values()) == {"0.0"}
    text = (place / "report" / "report.md").read_text(encoding="utf-8")
    assert re.search(r"\b0\.5 m\b.*\b5 m", text)
    assert "--delta 0.5" in text
    assert BLIND_ROW_TITLE not in text  # blind pilots were judged at 5 m only
    assert main(["report", "runs", "--out", "usual", "--no-page"]) == 0
    assert BLIND_ROW_TITLE in (place / "usual" / "report.md").read_text(encoding="utf-8")


def test_runs_of_different_kinds_are_rejected_unless_pool_anyway_is_set(place, capsys):
    write_run(place / "runs" / "again", IDS, seed=1, parser="lenient")
    assert main(["report", "runs", "--out", "report", "--no-page"]) == 2
    error = capsys.readouterr().err
    assert "parser" in error
    assert "--pool-anyway" in error
    assert not (place / "report").exists()
    assert main(["report", "runs", "--out", "report", "--no-page", "--pool-anyway"]) == 0
    text = (place / "report" / "report.md").read_text(encoding="utf-8")
    assert "--pool-anyway" in text


def test_the_error_names_the_run_that_differs_from_a_benchmark_and_a_remedy(place, capsys):
    suite = {"suite": {"name": "quick", "version": 1, "sha256": "5" * 64}}
    for k in (1, 2):
        write_run(place / "runs" / "bench" / f"f{k}", IDS, pilot="vision", seed=k)
        run_file = place / "runs" / "bench" / f"f{k}" / "run.json"
        run_file.write_text(json.dumps({**json.loads(run_file.read_text()), **suite}))
    write_run(place / "runs" / "alone", IDS, pilot="vision", seed=3)
    assert main(["report", "runs/alone", "runs/bench", "--out", "report", "--no-page"]) == 2
    error = capsys.readouterr().err
    assert re.search(r"runs/alone differs .*bench.*[Ll]eave \S*runs/alone out.*--pool-anyway", error), error


def test_a_copied_run_is_rejected(place, capsys):
    shutil.copytree(place / "runs" / "oracle", place / "runs" / "copy")
    assert main(["report", "runs", "--out", "report", "--no-page"]) == 2
    assert re.search("runs/copy/.*runs/oracle/.*seed 0", capsys.readouterr().err)


def test_one_episode_id_with_different_records_is_rejected(place, capsys):
    record = place / "runs" / "silent" / IDS[0] / "episode.json"
    record.write_text(json.dumps({**json.loads(record.read_text()), "instruction": "go elsewhere"}))
    assert main(["report", "runs", "--out", "report", "--no-page", "--pool-anyway"]) == 2
    assert f"'{IDS[0]}'" in capsys.readouterr().err


OWN = """
from dronecats.judge.metrics.metric import Metric

METRICS = (
    Metric(name="half", title="Half", unit="share", level="episode", better=None, definition="one half", paper="",
           of=lambda flown: 0.5),
    Metric(name="solved", title="Solved", unit="share", level="episode", better="more", definition="solved", paper="",
           of=lambda flown: flown.verdict.success),
    Metric(name="told_s", title="Told at", unit="s", level="step", better=None, definition="when it was told", paper="",
           of=lambda flown: [decision.t_decided for decision in flown.logs.decisions]),
    Metric(name="quarter", title="Quarter", unit="share", level="step", better=None, definition="a quarter", paper="",
           of=lambda flown: [0.25 for decision in flown.logs.decisions]),
)
"""


def test_custom_metrics_have_a_table(place, capsys):
    (place / "mine.py").write_text(OWN)
    assert main(["report", "runs", "--out", "report", "--no-page", "--metric", "mine.py", "--json"]) == 0
    lost, solved = last_object(capsys.readouterr().out)["tables"]["own"][::-1]
    assert (solved["approaching_half_percent"], solved["approaching_solved_percent"]) == (50.0, 100.0)
    assert (lost["approaching_solved_percent"], lost["approaching_told_s"]) == (0.0, 11.0)
    assert lost["approaching_quarter_percent"] == 25.0
    with (place / "report" / "tables" / "own.csv").open(encoding="utf-8", newline="") as file:
        row = next(csv.DictReader(file))
    assert row["approaching_solved_percent_of"] == "2"
    assert "approaching_half_percent_low" not in row, "a mean of fractions is no count of successes"
    (place / "mine.py").write_text(OWN.replace("0.5", "1 / 0"))
    assert main(["report", "runs", "--out", "report", "--no-page", "--metric", "mine.py"]) == 2
    assert re.search("half .*campus-searching-01 .*ZeroDivisionError", capsys.readouterr().err)


def test_a_damaged_episode_does_not_affect_other_episodes(place):
    (place / "runs" / "oracle" / IDS[1] / "truth.jsonl").write_text("{}\n{}\n")
    assert main(["report", "runs", "--out", "report", "--no-page"]) == 0
    text = (place / "report" / "report.md").read_text(encoding="utf-8")
    assert re.search(r"\b6 flights .*\b3 episodes.*\b5 .*scored", text)


def test_invalid_arguments_are_rejected(place, capsys):
    for arguments, expected in (
        (["runs", "--out", "report", "--delta", "0"], "--delta"),
        (["runs", "--out", "report", "--embed", "--no-page"], "--embed"),
        (["runs", "--out", "runs/oracle/run.json"], "runs/oracle/run.json"),
        (["nowhere", "--out", "report"], "nowhere"),
    ):
        assert main(["report", *arguments]) == 2, arguments
        assert expected in capsys.readouterr().err, arguments
