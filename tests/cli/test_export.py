"""The command `dronecats export`: output files, rejected arguments, and omitted episodes."""

import json

import pytest

from dronecats.cli.main import main
from tests.support.run_folders import run_folder


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_folder(tmp_path / "made", {"residential-searching-01": "find it", "residential-searching-02": "again"})
    return tmp_path


def test_each_episode_is_exported_to_its_own_file(place, capsys):
    assert main(["export", "made", "--to", "geojson", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result["files"]) == {f"made-geojson/residential-searching-0{n}.geojson" for n in (1, 2)}
    assert result["left_out"] == []
    assert not list(place.rglob("*.part"))


def test_existing_files_are_not_overwritten_without_the_option(place, capsys):
    assert main(["export", "made", "--to", "kml", "--out", "out"]) == 0
    file = place / "out" / "residential-searching-01.kml"
    file.write_text("mine")
    assert main(["export", "made", "--to", "kml", "--out", "out"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert main(["export", "made", "--to", "kml", "--out", "out", "--overwrite"]) == 0
    assert file.read_text() != "mine"


def test_existing_tables_are_not_overwritten(place, capsys):
    assert main(["export", "made", "--to", "csv", "--out", "out"]) == 0
    assert main(["export", "made", "--to", "csv", "--out", "out"]) == 2
    assert main(["export", "made", "--to", "parquet", "--out", "out"]) == 0


def test_unfinished_or_damaged_episodes_are_named_and_the_others_exported(place, capsys):
    truth = place / "made" / "residential-searching-01" / "truth.jsonl"
    truth.write_text("".join(line for line in truth.open() if '"end"' not in line))
    assert main(["export", "made", "--to", "geojson", "--out", "out"]) == 0
    assert "residential-searching-01" in capsys.readouterr().err
    assert [path.name for path in (place / "out").iterdir()] == ["residential-searching-02.geojson"]
    truth.write_text("[]\n")
    assert main(["export", "made/residential-searching-01", "--to", "geojson", "--out", "other"]) == 2
    assert "truth.jsonl line 1 " in capsys.readouterr().err


def test_runs_of_the_same_episode_get_separate_files(place, capsys):
    run_folder(place / "other", {"residential-searching-01": "find it"}, seed=1)
    assert main(["export", "made", "other", "--to", "geojson", "--out", "out"]) == 0
    assert len(list((place / "out").glob("*/residential-searching-01.geojson"))) == 2


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [(["nowhere", "--to", "kml"], "nowhere"), (["made", "--to", "kml", "--out", "made/run.json"], "made/run.json")],
)
def test_errors_are_one_sentence(arguments, expected, place, capsys):
    assert main(["export", *arguments]) == 2
    err = capsys.readouterr().err
    assert expected in err
    assert len(err.splitlines()) == 1
