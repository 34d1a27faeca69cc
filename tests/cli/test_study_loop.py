"""The command `dronecats study loop`."""

import json
import re

import pytest

from dronecats.cli.main import main


def test_one_loop_gets_a_page_with_its_figures_and_margins(tmp_path, capsys):
    words = ["study", "loop", "--airframe", "nano", "--loops", "yaw attitude", "--part", "margins", "--json"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    (row,) = result["loops"]
    assert row["loop"] == "yaw attitude"
    assert row["airframe"] == "nano"
    assert abs(row["off_percent"]) <= 20.0
    page = (tmp_path / "loop-margins.md").read_text()
    assert 'dronecats study loop --airframe nano --loops "yaw attitude" --part margins' in page
    assert re.search(rf"nano\b.*\byaw attitude\b.*\b{row['rise_s']:g} s", page)
    for name in ("margins", "steps", "onset"):
        assert f"({name}.png)" in page
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000 < (tmp_path / f"{name}.svg").stat().st_size
    assert (tmp_path / "margins.csv").read_text().startswith("airframe,loop,rise_s")
    assert not (tmp_path / "stream.csv").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["--loops", "position"],
        ["--airframe", "nobody"],
        ["--part", "margins", "--px4", "./px4"],
        ["--px4", " "],
        ["--px4", "./px4", "--airframe", "hexa"],
        ["--out", __file__],
    ],
)
def test_invalid_arguments_are_rejected(words, capsys):
    assert main(["study", "loop", *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_missing_px4_program_is_rejected_before_any_flight(capsys):
    assert main(["study", "loop", "--airframe", "nano", "--px4", "./no-such-px4"]) == 2
    trying, *complaint = capsys.readouterr().err.strip().splitlines()
    assert "nano" in trying
    assert len(complaint) == 1
    assert "--px4 './no-such-px4'" in complaint[0]


def test_the_output_of_a_px4_that_exits_at_once_is_kept(tmp_path, capsys):
    command = "sh -c 'echo no board; exit 4' {instance}"  # on free ports
    assert main(["study", "loop", "--airframe", "nano", "--px4", command, "--out", str(tmp_path / "loop")]) == 3
    error = capsys.readouterr().err
    assert "exit status 4" in error.splitlines()[-1]
    assert "loops …" not in error  # no progress of the margins, which take minutes
    (log,) = (tmp_path / "loop").glob("px4-*.log")
    assert str(log) in error
    assert log.read_text() == "no board\n"
