"""The report's files equal the reviewed report and are reproducible. The figures agree with their tables."""

import subprocess
import sys
from functools import cache

import pytest

from dronecats.report import figures as drawing
from dronecats.report import figures as style
from dronecats.report import report_data
from dronecats.report.report_folder import TABLES, tables, write
from dronecats.report.table import ReportTable
from foundation.errors import InfrastructureError
from tests.report import golden
from tests.report.small import line, small
from tests.support.scores import a_run, an_episode, collected, named


def files(folder):
    return {str(path.relative_to(folder)): path.read_text(encoding="utf-8") for path in folder.rglob("*.*")}


def test_the_small_report_equals_the_reviewed_report(tmp_path):
    golden.report(tmp_path)
    assert files(tmp_path) == files(golden.FOLDER)


def test_a_second_report_removes_the_tables_and_figures_that_it_lacks(tmp_path):
    made, figures = tables(small()), tmp_path / "figures"
    written = write(made, drawing.draw(small(), made, figures), (), tmp_path)
    (tmp_path / "tables" / "mine.csv").write_text("a file of the user")
    (figures / "mine.png").write_text("a file of the user")
    oracle = small(collected([an_episode(a_run(pilot="oracle"), "campus-tracking-01")]))
    made = tables(oracle)
    drawn_figures = drawing.draw(oracle, made, figures)
    write(made, drawn_figures, (), tmp_path)
    assert {path.stem for path in written.parent.glob("tables/*")} == {"mine", *(table.name for table in made)}
    assert {path.stem for path in figures.iterdir()} == {"mine", *(path.stem for path in drawn_figures.values())}


def test_the_name_of_a_table_is_the_name_of_its_function():
    assert all(made.name == table.__name__ for table in TABLES if (made := table(small())) is not None)


def test_a_file_in_place_of_the_tables_folder_is_reported(tmp_path):
    (tmp_path / "tables").write_text("a file where a folder should be")
    with pytest.raises(InfrastructureError, match=str(tmp_path)):
        write((), {}, (), tmp_path)


ENDED = ("success", "declared", "arrived", "did not move")


@cache
def report_tables(ended=ENDED) -> dict[str, ReportTable]:
    """Return tables with data for every figure."""
    run = a_run("runs/m", model=named("m"))
    steps = {"rate_hz": tuple(float(n) for n in range(1, 22))}
    episodes = [an_episode(run, f"campus-approaching-{k:02}", "success" if mode == "success" else "failure", mode=mode,
                        steps=steps) for k, mode in enumerate(ended)]  # fmt: skip
    drones = {"drones_found": 1, "drones_beside": 2, "drones_elsewhere": 0, "drones_silent": 1}
    episodes.append(an_episode(run, "blocks-commanding-01", "success", values=drones))
    episodes.append(an_episode(a_run("runs/o", pilot="oracle"), "campus-approaching-00", "success", mode="success"))
    return {table.name: table for table in tables(small(collected(episodes)))}


def drawn(figure):
    """Return the bars of a figure as (left, width, y of the centre), rounded."""
    (axis,) = figure.axes
    return [
        (round(p.get_x(), 3), round(p.get_width(), 3), round(p.get_y() + p.get_height() / 2, 3)) for p in axis.patches
    ]


def test_failure_bars_are_stacked_and_equal_the_shares_of_the_table():
    bars = drawn(drawing.draw_failure_modes(report_tables()["failures"]))
    bar = [(left, width) for left, width, y in bars if y == bars[0][2] and width]
    assert bar == [(0, 25), (25, 25), (50, 25), (75, 25)]


def test_the_numbers_in_failure_bars_equal_the_shares_of_the_table():
    table = report_tables(("success",) * 7 + ("declared",))["failures"]
    (axis,) = drawing.draw_failure_modes(table).axes
    shares = [cell.text(column) for cell, column in zip(table.rows[0].cells, table.columns, strict=True)][2:4]
    assert shares == ["88", "13"]
    written = [text.get_text() for text in axis.texts if text.get_text().isdigit()]
    assert written == [shares[0], "100", shares[1]]  # the successes of m and of the oracle come first


def test_drone_bars_are_stacked_and_the_diamond_marks_the_success_rate():
    figure = drawing.draw_drone_outcomes(report_tables()["drones"])
    assert [bar[:2] for bar in drawn(figure) if bar[1]] == [(0, 25), (25, 50), (75, 25)]
    (axis,) = figure.axes
    assert [list(mark.get_xdata()) for mark in axis.lines if mark.get_marker() == "D"] == [[100.0]]


def test_nested_bars_equal_the_rates_of_the_table():
    table = report_tables()["approaching"]
    row = line(table, "vllm/m")
    widths = [width for _, width, _ in drawn(drawing.draw_reach_declare_succeed(table))]
    assert widths[0::2] == [row[column].value for column, _, _ in drawing.NESTED]


def test_boxes_equal_the_quantiles_of_the_table():
    (box,) = drawn(drawing.rates(report_tables()["served"]))
    assert box[:2] == (6.0, 10.0)


def test_models_and_built_in_pilots_are_in_separate_blocks_of_a_figure():
    lines, heads = style.lines(report_tables()["approaching"])
    assert [title for title, _ in heads] == [report_data.MODELS, report_data.BUILT_IN]
    assert lines[0][1] < heads[1][1] < lines[1][1]


def test_every_figure_is_drawn_in_three_formats_and_is_reproducible(tmp_path, monkeypatch):
    monkeypatch.setitem(style.SETTINGS, "savefig.dpi", 50)  # the time that a PNG takes grows with its pixels
    benchmark_data, all_tables = small(), report_tables()
    first = drawing.draw(benchmark_data, tuple(all_tables.values()), tmp_path / "a")
    again = drawing.draw(benchmark_data, (all_tables["drones"],), tmp_path / "b")
    assert list(first) == ["approaching", "failures", "drones", "served", drawing.GRID]
    assert [path.name for path in first.values()] == [
        "reach_declare_succeed.png", "failure_modes.png", "commanding_by_drone.png", "served_rate.png",
        "episode_by_episode.png",
    ]  # fmt: skip
    assert list(again) == ["drones", drawing.GRID]
    for name, path in first.items():
        for kind in style.FORMATS:
            data = path.with_suffix(f".{kind}").read_bytes()
            assert len(data) > 1000
            if name in again:
                assert data == again[name].with_suffix(f".{kind}").read_bytes(), f"{name}.{kind}"


def test_importing_the_report_command_imports_no_matplotlib_and_no_numpy():
    code = "import sys, dronecats.cli.report; assert 'matplotlib' not in sys.modules and 'numpy' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
