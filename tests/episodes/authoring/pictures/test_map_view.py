"""The pictures of the maps: each map has one, below the size limit. Repeated runs write the same bytes."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from episodes import maps
from episodes.authoring.scene_pictures import LARGEST_BYTES, SIDE_PX, write_map_plan, write_map_view
from foundation.errors import UsageError
from tests import pictures

SHIPPED = Path(__file__).parents[4] / "docs" / "maps"


def test_a_map_view_has_the_same_bytes_each_time(tmp_path: Path) -> None:
    first, second = tmp_path / "a.jpg", tmp_path / "deeper" / "b.jpg"
    write_map_view("blocks", first)
    write_map_view("blocks", second)
    assert first.read_bytes() == second.read_bytes()
    picture = pictures.read(first)
    assert picture.shape == (720, 1280, 3)
    assert picture[:100].mean() > picture[-100:].mean()  # the sky is above, and brighter than the floor
    assert np.abs(np.diff(picture[300:500].astype(int), axis=1)).max() > 60  # solids contrast with the background


def test_unknown_maps_and_unwritable_files_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="blocks"):
        write_map_view("blokcs", tmp_path / "a.jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"file/a.jpg"):
        write_map_view("blocks", tmp_path / "file" / "a.jpg")


def test_the_plan_labels_its_objects(tmp_path: Path) -> None:
    """Only the labels have ink this dark."""
    write_map_plan("blocks", tmp_path / "plan.jpg")
    plan = pictures.read(tmp_path / "plan.jpg", cv2.IMREAD_GRAYSCALE)
    assert plan.shape == (SIDE_PX, SIDE_PX)
    rows, columns = np.nonzero(plan < 60)
    assert len(rows) > 20 * len(maps.build("blocks").instances)
    assert np.ptp(rows) > 0.8 * SIDE_PX  # from the north side of the ring to the south side
    assert np.ptp(columns) > 0.8 * SIDE_PX


@pytest.mark.parametrize("name", maps.shipped())
def test_a_picture_of_each_map_is_shipped(name: str) -> None:
    assert name in maps.VANTAGE
    file = SHIPPED / f"{name}.jpg"
    assert file.stat().st_size <= LARGEST_BYTES
    assert pictures.read(file).shape == (720, 1280, 3)
