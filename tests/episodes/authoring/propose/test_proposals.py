"""Proposed records pass all rules. The same seed gives the same records."""

import itertools
import math
import random
from pathlib import Path

import numpy as np
import pytest

from dronecats.cli.main import main
from episodes import maps
from episodes.authoring.check.rules import check
from episodes.authoring.propose import draft
from episodes.authoring.propose.proposals import RecordRequest, first_free, propose
from episodes.authoring.propose.site import stretch
from episodes.maps import assets
from episodes.maps.scene import Places
from episodes.records import catalogue
from episodes.records.record import CELLS, HIDDEN, parse
from episodes.world.world import World
from foundation.errors import UsageError
from foundation.terrain import HeightField


@pytest.mark.parametrize(
    "wanted",
    [
        pytest.param(RecordRequest("residential", "searching", 7, 1, 5), id="residential"),
        pytest.param(RecordRequest("residential", "tracking", 1, 2, 5), id="tracking", marks=pytest.mark.slow),
        pytest.param(RecordRequest("campus", "approaching", 1, 2, 5), id="campus", marks=pytest.mark.slow),
        pytest.param(RecordRequest("campus", "search-and-track", 1, 3, 5), id="walking", marks=pytest.mark.slow),
        pytest.param(RecordRequest("blocks", "commanding", 1, 2, 5), id="commanding", marks=pytest.mark.slow),
    ],
)
def test_proposals_are_sound_and_reproducible(wanted: RecordRequest) -> None:
    proposals = propose(wanted)
    assert [r.id for r in proposals] == [
        f"{wanted.map}-{wanted.cell}-{wanted.first + k:02d}" for k in range(wanted.count)
    ]
    for record in proposals:
        assert parse(record.to_json(), "again") == record
        assert all(f.passed for f in check(World(record)))
        assert record.visible_at_start == (record.cell not in HIDDEN)
    assert [r.to_json() for r in propose(wanted)] == [r.to_json() for r in proposals]


def test_another_seed_makes_other_records() -> None:
    a, b = (propose(RecordRequest("residential", "approaching", 1, 1, seed))[0] for seed in (1, 2))
    assert (a.target, a.starts) != (b.target, b.starts)


def test_command_writes_records_that_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--map", "residential", "--cell", "approaching", "--count", "1", "--seed", "3", "--out", str(tmp_path)]
    assert main(["episodes", "new", *options]) == 0
    file = tmp_path / "residential-approaching-11.json"  # ten records are shipped
    assert str(file) in capsys.readouterr().out
    assert catalogue.load(file).cell == "approaching"
    assert main(["episodes", "new", *options]) == 0  # a repeated command succeeds
    file.write_text("what somebody has made of it")
    assert main(["episodes", "new", *options]) == 2
    assert str(file) in capsys.readouterr().err
    assert file.read_text() == "what somebody has made of it"


def test_an_unwritable_file_is_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "blocks-commanding-20.json").mkdir()
    options = ["--map", "blocks", "--cell", "commanding", "--first", "20", "--out", str(tmp_path)]
    assert main(["episodes", "new", *options]) == 2
    assert "blocks-commanding-20.json" in capsys.readouterr().err


def test_new_numbers_follow_the_shipped_records() -> None:
    assert first_free("blocks", "commanding") == 11
    assert first_free("residential", "search-and-track") == 11
    assert first_free("campus", "commanding") == first_free("my-yard", "tracking") == 1


def test_invalid_requests_are_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, says in (
        (["--map", "moon", "--cell", "approaching"], "'moon'"),
        (["--map", "campus", "--cell", "chasing"], "'chasing'"),
        (["--map", "campus", "--cell", "approaching", "--count", "0"], "--count"),
        (["--map", "campus", "--cell", "approaching", "--count", "10", "--first", "95"], "--first"),
        (["--map", "campus", "--cell", "approaching", "--seed", "-1"], "--seed"),
        (["--map", "campus"], "--cell"),
    ):
        assert main(["episodes", "new", *arguments, "--out", str(tmp_path / "made")]) == 2, arguments
        assert says in capsys.readouterr().err, arguments


def test_a_stretch_of_a_lane_follows_the_terrain() -> None:
    north, east = np.meshgrid(np.arange(-10, 70, 0.25), np.arange(-10, 30, 0.25), indexing="ij")
    terrain = HeightField(-10.0, -10.0, 0.25, 0.4 * np.sin(north / 3.0) * np.cos(east / 5.0))
    lane = [(0.0, 0.0, 0.0), (20.0, 4.0, 0.0), (40.0, 0.0, 0.0), (60.0, 20.0, 0.0)]
    points = stretch(lane, 7.5, 40.0, terrain)
    flat = sum(math.dist(a[:2], b[:2]) for a, b in itertools.pairwise(points))
    assert flat == pytest.approx(40.0, abs=0.01)
    assert len(points) <= 200
    for a, b in itertools.pairwise(points):
        for u in np.linspace(0.0, 1.0, 40):
            n, e, d = (float(p + u * (q - p)) for p, q in zip(a, b, strict=True))
            assert abs(d - terrain.at(n, e)) < 0.02


def test_instructions_suit_the_cell_and_the_target() -> None:
    rng = random.Random(1)
    for cell in CELLS:
        for asset in assets.names():
            text = draft.instruction(cell, "the thing", asset, rng)
            assert "the thing" in text
            assert "{" not in text
    instructions = {draft.instruction("tracking", "the person", "person", rng) for _ in range(40)}
    assert any(text.endswith(" them") for text in instructions)
    assert not any(text.endswith(" it") for text in instructions)


def test_plates_are_similar_and_distinct() -> None:
    for seed in range(20):
        texts = draft.plates(4, random.Random(seed))
        assert len(set(texts)) == 4
        for a, b in itertools.combinations(texts, 2):
            assert 1 <= sum(x != y for x, y in zip(a, b, strict=True)) <= 4


def test_a_map_without_places_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    for cell in CELLS:
        monkeypatch.setattr(maps, "places", lambda name, seed: Places((), ()))
        with pytest.raises(UsageError, match="blocks"):
            propose(RecordRequest("blocks", cell, 1, 1, 1))
