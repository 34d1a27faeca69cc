"""`dronecats study loop`, as it is typed."""

import json

import pytest

from dronecats.cli.main import main


def test_one_loop_on_a_page(tmp_path, capsys):
    words = ["study", "loop", "--airframe", "nano", "--loops", "yaw attitude", "--part", "margins", "--json"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)
    (row,) = found["loops"]
    assert row["loop"] == "yaw attitude"
    assert row["airframe"] == "nano"
    assert abs(row["off_percent"]) <= 20.0
    page = (tmp_path / "loop-margins.md").read_text()
    assert 'dronecats study loop --airframe nano --loops "yaw attitude" --part margins --out DIR' in page
    assert f"| nano | yaw attitude | {row['rise_s']:g} s |" in page
    for name in ("margins", "steps", "onset"):
        assert f"({name}.png)" in page
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000 < (tmp_path / f"{name}.svg").stat().st_size
    assert (tmp_path / "margins.csv").read_text().startswith("airframe,loop,rise_s")
    assert not (tmp_path / "stream.csv").exists()


@pytest.mark.parametrize("words", [["--loops", "position"], ["--airframe", "nobody"]])
def test_what_is_not_there_is_wrong_usage(words, capsys):
    assert main(["study", "loop", *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
