"""The reading probe: its pictures equal those that a model gets, and its letters have the geometric height."""

import json

import cv2
import numpy as np
import pytest

from dronecats.cli.main import main
from episodes.authoring import asset_pictures as reading
from episodes.maps import assets
from foundation.camera import encode
from tests import pictures

SIGN, PLATE = reading.KINDS


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("probe")
    return folder, reading.write_probe(folder, 3)


def height_of_ink(grey, focal, kind, text, distance):
    """Return the height of the letters in px, with sub-pixel accuracy.

    It is the distance between the rows where the profile of the ink crosses half of its maximum.
    """
    face = reading.face_of(assets.build(kind.asset, kind.paint, text), kind.material)
    middle = grey.shape[0] / 2 + focal * max(0.0, reading.LEAST_EYE_M - face.height) / distance
    letter = focal * kind.letter_m / distance
    wide, high = round(1.6 * letter), 0.68 * letter  # covers the middle letters and a margin of background
    x = grey.shape[1] // 2
    rows = np.arange(int(middle - high), int(middle + high) + 1)
    ink = grey[rows, x - wide : x + wide].astype(float).mean(axis=1)
    ink = max(ink[0], ink[-1]) - ink
    half = 0.5 * np.median(ink[ink > 0.5 * ink.max()])
    inside = np.flatnonzero(ink > half)
    first, last = inside[0], inside[-1]
    before = (ink[first] - half) / (ink[first] - ink[first - 1])
    after = (ink[last] - half) / (ink[last] - ink[last + 1])
    return last - first + before + after


@pytest.mark.parametrize("kind", reading.KINDS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("distance", [4, 6])
def test_drawn_letters_have_the_geometric_height(kind, distance):
    text = "HHH 00" if kind is SIGN else "HH 1111"
    seen = cv2.imdecode(np.frombuffer(encode(reading.view(kind, text, distance)), np.uint8), 0)
    measured = height_of_ink(seen, 320.0, kind, text, distance)
    assert measured == pytest.approx(reading.letter_px(kind, distance), rel=0.10)


def test_each_file_has_the_bytes_that_the_agent_sends(written):
    folder, probes = written
    for probe in (probes[0], probes[-1]):
        kind = SIGN if probe.kind == "sign" else PLATE
        frame = reading.view(kind, probe.text, probe.distance_m)
        assert (folder / probe.file).read_bytes() == encode(frame)
        assert pictures.read(folder / probe.file).shape == (360, 640, 3)


def test_the_index_lists_every_picture_of_both_kinds_at_every_distance(written):
    folder, probes = written
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    assert index["seed"] == 3
    assert [p["file"] for p in index["probes"]] == [p.file for p in probes]
    assert {(p.kind, p.distance_m) for p in probes} == {(k, d) for k in ("sign", "plate") for d in range(4, 17, 2)}
    assert {path.name for path in folder.iterdir()} == {p.file for p in probes} | {"index.json", "contact-sheet.png"}
    assert all(
        p.letter_px * p.distance_m == pytest.approx(320 * (0.136 if p.kind == "sign" else 0.1), abs=0.1) for p in probes
    )


def test_inscriptions_are_unique_and_not_used_by_an_episode(written):
    texts = [probe.text for probe in written[1]]
    assert len(set(texts)) == len(texts)
    assert not set(texts) & reading.used_inscriptions()
    assert len(reading.used_inscriptions()) > 20


def test_inscriptions_depend_only_on_the_seed():
    def drawn(seed):
        rng = np.random.default_rng(seed)
        return [reading.invent(kind, rng, set()) for kind in ("sign", "plate", "sign")]

    assert drawn(1) == drawn(1) != drawn(2)


def test_invalid_arguments_print_one_error_and_exit_with_2(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    assert main(["episodes", "probe", "--out", str(file / "below"), "--seed", "1"]) == 2
    assert main(["episodes", "probe", "--out", str(tmp_path), "--seed", "-1"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2
