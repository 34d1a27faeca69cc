"""The files of a study report beside the page: Markdown, tables, figures and data with the same numbers."""

import csv
import json
import re
import shlex
import shutil

import duckdb
import pytest

from dronecats.cli.main import main
from dronecats.study.analysis.loading import load_results
from dronecats.study.report import report_folder
from dronecats.study.report.report_folder import write
from tests.study.studies import change_run, falling, write_study

FIGURES = {
    *(f"{name}_{factor}" for factor in ("latency", "wind")
      for name in ("success", "success_beside", "measures", "against_reference", "between_entrants", "target_motion",
                   "served")),
    "main_effects", "interaction_latency_wind", "at_points",
}  # fmt: skip


def rows(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_figure_is_written_as_vector_and_as_raster_image(report):
    drawn = {path.name for path in (report / "figures").iterdir()}
    assert drawn == {f"{name}.{kind}" for name in FIGURES for kind in ("svg", "pdf", "png")}
    assert all(path.stat().st_size > 2000 for path in (report / "figures").iterdir())


def test_each_figure_is_shown_with_the_command_that_made_it(report, study_folder):
    command = shlex.join(["dronecats", "study", "report", str(study_folder), "--out", str(report)])
    for page in ("report.md", "index.html"):
        text = (report / page).read_text(encoding="utf-8")
        assert text.count(command) > len(FIGURES)
    markdown = (report / "report.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\(figures/(\w+)\.png\)", markdown)) == FIGURES


@pytest.fixture
def without_figures(monkeypatch):
    """Omit the figures, which take most of the time of a report."""
    monkeypatch.setattr(report_folder, "draw", lambda findings, out: [])


@pytest.mark.usefixtures("without_figures")
def test_the_report_of_a_study_without_scored_flights_counts_them_as_0(tmp_path):
    axes = {"latency": (0.0, 1.0), "wind": (0.0, 8.0)}
    write_study(tmp_path / "s", axes, lambda pilot, levels: -99.0, pilots=("vision", "oracle"), errors=1.0)
    assert main(["study", "report", str(tmp_path / "s")]) == 0
    text = (tmp_path / "s/report/report.md").read_text(encoding="utf-8")
    assert re.search(r"\b32 flights .*\b4 episodes.*\b0 .*scored", text)


def test_the_data_files_contain_every_flight_as_csv_and_as_parquet(report):
    flights = rows(report / "data/flights.csv")
    assert len(flights) == 3 * 2 * 2 * 5
    stored = duckdb.connect().execute(f"SELECT * FROM '{report / 'data/flights.parquet'}'")
    assert list(flights[0]) == [column[0] for column in stored.description or ()]
    again = stored.fetchall()
    for line, row in zip(flights, again, strict=True):
        for text, value in zip(line.values(), row, strict=True):
            same = text == "" if value is None else text == str(value).lower() or float(text) == value \
                if not isinstance(value, str) else text == value  # fmt: skip
            assert same, (text, value)
    won = [row["success"] == "true" for row in flights if (row["entrant"], row["level_latency"]) == ("vision", "1.0")]
    share = sum(won) / len(won)
    table = rows(report / "tables/measures_latency.csv")
    [line] = [row for row in table if row["block"] == "vision, all cells" and row["level"] == "1 s"]
    assert float(line["success_percent"]) == pytest.approx(100 * share)


def test_every_table_is_written_as_csv_and_latex_and_in_the_markdown(report):
    markdown = (report / "report.md").read_text(encoding="utf-8")
    names = {path.stem for path in (report / "tables").glob("*.csv")}
    assert names == {path.stem for path in (report / "tables").glob("*.tex")}
    assert {"main_effects", "setup", "half_success_latency", "served_wind", "target_motion_latency"} <= names
    assert len(re.findall(r"^\|( :---| ---:)", markdown, re.MULTILINE)) == len(names)


def test_two_reports_of_the_same_flights_are_equal(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_study(tmp_path / "s", {"latency": (0.0, 1.0)}, falling())

    def report_files():
        kinds = (".csv", ".md", ".tex", ".html", ".svg", ".pdf")
        return {path.name: path.read_bytes() for path in (tmp_path / "r").rglob("*") if path.suffix in kinds}

    assert main(["study", "report", "s", "--out", "r"]) == 0
    once = report_files()
    capsys.readouterr()
    assert main(["study", "report", "s", "--out", "r", "--json"]) == 0
    assert report_files() == once
    output = json.loads(capsys.readouterr().out)
    assert re.search(r"\b8 flights .*\b4 episodes.*\b8 .*scored", output["short"][0])
    assert {row["level"] for row in output["tables"]["measures_latency"]} == {"0 s", "1 s"}


@pytest.mark.usefixtures("without_figures")
def test_the_half_success_point_is_a_number_within_the_levels_and_words_outside(tmp_path, capsys):
    write_study(tmp_path / "in", {"latency": (0.0, 1.0, 2.0, 4.0)}, falling(), flights=4, scatter=0.5)
    write_study(tmp_path / "out", {"latency": (0.0, 0.5)}, falling(half=9.0), flights=2)
    page = write(load_results(tmp_path / "in"), "dronecats study report", tmp_path / "r").page
    (within,) = rows(tmp_path / "r/tables/half_success_latency.csv")
    assert re.fullmatch(r"[01]\.\d+ s", within["half"])
    assert re.search(rf"latency\b.* {within['half']} \(", page.read_text(encoding="utf-8"))
    assert main(["study", "report", str(tmp_path / "out")]) == 0
    (outside,) = rows(tmp_path / "out/report/tables/half_success_latency.csv")
    assert not re.search(r"\d", outside["half"])
    share = outside["half"].removesuffix(" at every level")
    assert f"{share} of the flights succeed at every level of latency" in capsys.readouterr().out
    assert (tmp_path / "out/report/index.html").exists()  # beside the study by default


@pytest.mark.usefixtures("without_figures")
def test_the_report_of_an_unfinished_study_counts_the_missing_flights(tmp_path, capsys):
    plan = write_study(tmp_path / "s", {"latency": (0.0, 1.0)}, falling(), flights=2)
    shutil.rmtree(tmp_path / "s" / plan.entries[-1].name)
    assert main(["study", "report", str(tmp_path / "s")]) == 0
    assert "4 of 16 flights" in capsys.readouterr().out


def test_errors_are_one_line(tmp_path, capsys):
    assert main(["study", "report", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    plan = write_study(tmp_path / "s", {"latency": (0.0, 1.0)}, falling())
    change_run(tmp_path / "s" / plan.entries[0].name, clock="real time")
    assert main(["study", "report", str(tmp_path / "s")]) == 2
    assert re.search("clock.*real time.*lockstep", capsys.readouterr().err)
    (tmp_path / "file").write_text("")
    assert main(["study", "report", str(tmp_path / "s"), "--out", str(tmp_path / "file")]) == 2
