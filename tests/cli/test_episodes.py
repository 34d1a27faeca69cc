"""The command `dronecats episodes …`."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from dronecats.cli.main import main
from episodes.maps import build
from episodes.records import catalogue
from episodes.records.catalogue import load_par
from foundation.errors import UsageError
from tests import pictures

SHIPPED = catalogue.load(catalogue.DEFAULT)


def output_of(capsys: pytest.CaptureFixture[str], *arguments: str, status: int = 0) -> str:
    assert main(["episodes", *arguments]) == status
    return capsys.readouterr().out


def test_list_has_a_row_for_every_episode_and_can_filter_by_suite(capsys: pytest.CaptureFixture[str]) -> None:
    rows = json.loads(output_of(capsys, "list", "--json"))["episodes"]
    assert [row["id"] for row in rows] == catalogue.ids()
    assert set(rows[0]) == {"id", "map", "cell", "suites", "drones", "par", "instruction"}
    quick = json.loads(output_of(capsys, "list", "--json", "--suite", "quick"))["episodes"]
    assert {row["id"] for row in quick} == {row["id"] for row in rows if "quick" in row["suites"]}
    names = {line.split()[0] for line in output_of(capsys, "list").splitlines()}
    assert names >= set(catalogue.ids())


def test_an_unknown_suite_is_rejected(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["episodes", "list", "--suite", "comanding"]) == 2
    assert "commanding" in capsys.readouterr().err
    with pytest.raises(UsageError):
        catalogue.suite_ids("")


def test_the_suites_one_drone_and_commanding_partition_the_catalogue() -> None:
    everything = set(catalogue.suite_ids("all"))
    assert set(catalogue.suite_ids("one-drone")) | set(catalogue.suite_ids("commanding")) == everything
    assert not set(catalogue.suite_ids("one-drone")) & set(catalogue.suite_ids("commanding"))
    assert catalogue.suites_of(catalogue.DEFAULT) == ("one-drone", "quick", "all")
    assert catalogue.suites_of("mine") == ()


def test_show_prints_the_episode_and_saves_its_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    picture = tmp_path / "first.png"
    text = output_of(capsys, "show", catalogue.DEFAULT, "--picture", str(picture))
    for part in ("residential", "approaching", "one-drone, quick, all", "cyan suv", SHIPPED.instruction):
        assert part in text
    drawn = pictures.read(picture)
    assert drawn.shape == (720, 1280, 3)
    assert drawn.std() > 20.0
    shown = json.loads(output_of(capsys, "show", catalogue.DEFAULT, "--json"))
    assert shown["record"] == json.loads(SHIPPED.to_json())
    assert shown["drones"] == 1


def test_only_shipped_episodes_belong_to_a_suite(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    same, other = tmp_path / "same.json", tmp_path / "other.json"
    same.write_text(SHIPPED.to_json())
    other.write_text(replace(SHIPPED, seed=SHIPPED.seed - 1).to_json())
    assert "quick" in json.loads(output_of(capsys, "show", str(same), "--json"))["suites"]
    shown = json.loads(output_of(capsys, "show", str(other), "--json"))
    assert shown["suites"] == []
    assert shown["par"] is None


def test_show_rejects_an_unknown_picture_format(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["episodes", "show", catalogue.DEFAULT, "--picture", str(tmp_path / "first.gif")]) == 2
    assert ".png" in capsys.readouterr().err


def test_check_accepts_valid_and_rejects_invalid_episodes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    house = next(i.position_ned for i in build("residential", 1).instances if i.kind == "house")
    walled = tmp_path / "walled.json"
    walled.write_text(replace(SHIPPED, id="walled", target=replace(SHIPPED.target, position_ned=house)).to_json())
    torn = tmp_path / "torn.json"
    torn.write_text(SHIPPED.to_json()[:100])
    answer = json.loads(output_of(capsys, "check", catalogue.DEFAULT, "--json", "--jobs", "1"))
    assert answer == {"checked": 1, "rejected": {}, "suite": []}
    answer = json.loads(output_of(capsys, "check", str(walled), str(torn), "--json", "--jobs", "1", status=1))
    assert answer["checked"] == 2
    assert set(answer["rejected"]) == {"walled", str(torn)}
    assert "walled.json" not in answer["rejected"][str(torn)]
    assert re.search(r"'target\.position_ned'.* house-", answer["rejected"]["walled"])
    text = output_of(capsys, "check", str(walled), "--jobs", "1", "--rules", status=1)
    assert re.search(r"\b1 checked.*\b1 rejected", text)


def test_check_reports_every_file_even_with_the_same_id(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    files = [tmp_path / "one.json", tmp_path / "two.json"]
    for file, distance in zip(files, (3.0, 4.0), strict=True):
        file.write_text(replace(SHIPPED, start_distance_m=distance).to_json())
    paths = [str(file) for file in files]
    answer = json.loads(output_of(capsys, "check", *paths, catalogue.DEFAULT, "--json", "--jobs", "1", status=1))
    assert answer["checked"] == 3
    assert set(answer["rejected"]) == set(paths)


def test_check_suggests_the_nearest_episode_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["episodes", "check", "residential-aproaching-01"]) == 2
    assert "residential-approaching-01" in capsys.readouterr().err


def test_the_par_table_has_only_shipped_episodes_and_valid_values(tmp_path: Path) -> None:
    assert set(load_par()) <= set(catalogue.all_ids())
    assert load_par(tmp_path / "none.json") == {}
    file = tmp_path / "par.json"
    file.write_text('{"a": 9}')
    assert load_par(file) == {"a": 9}
    for wrong in ("[]", '{"a": 0}', '{"a": true}', '{"a": 1.5}'):
        file.write_text(wrong)
        with pytest.raises(UsageError, match=r"par\.json"):
            load_par(file)


def test_recorded_start_positions_are_rounded_to_millimetres(tmp_path: Path) -> None:
    """Records store millimetres and tenths of degrees. A redraw uses the stored numbers."""
    for name in catalogue.ids():
        for start in catalogue.load(name).starts:
            assert all(math.isclose(v, round(v, 3), abs_tol=1e-12) for v in start.position_ned)


def test_sheet_draws_the_named_objects_and_rejects_invalid_arguments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sheet.jpg"
    output_of(capsys, "sheet", "suv", "--out", str(file))
    single = pictures.read(file)
    output_of(capsys, "sheet", "suv", "bus", "--out", str(file))
    double = pictures.read(file)
    assert double.shape[1] == single.shape[1]
    assert double.shape[0] > single.shape[0]
    assert main(["episodes", "sheet", "suw", "--out", str(file)]) == 2
    assert "suv" in capsys.readouterr().err
    assert main(["episodes", "sheet", "suv", "--out", str(tmp_path / "sheet.gif")]) == 2
    assert "sheet.gif" in capsys.readouterr().err
    assert not (tmp_path / "sheet.gif").exists()
