"""Contact sheets have one row per asset and one column per distance. Repeated runs write the same bytes."""

import re
from pathlib import Path

import numpy as np
import pytest

from episodes.authoring.asset_pictures import DISTANCES_M, HEIGHT_PX, LABEL_PX, WIDTHS_PX, names, write_contact_sheet
from episodes.maps import assets
from foundation.errors import UsageError
from tests import pictures

SHEETS = Path(__file__).parents[4] / "docs" / "assets"


def test_a_sheet_shows_each_asset_at_each_distance(tmp_path: Path) -> None:
    out = tmp_path / "new" / "sheet.jpg"
    write_contact_sheet(["suv", "quadrotor"], out)  # cyan and red
    picture = pictures.read(out).astype(int)[..., ::-1]
    rows = (picture.shape[0] - LABEL_PX) // 2
    assert abs(rows - LABEL_PX - HEIGHT_PX) < 10
    covered = []
    for row, (strong, weak) in enumerate((((1, 2), 0), ((0,), 1))):
        top = LABEL_PX + row * rows + LABEL_PX
        tile = picture[top : top + HEIGHT_PX]
        shown = (tile[..., list(strong)].min(axis=2) - tile[..., weak]) > 60
        left = 0
        for width in WIDTHS_PX:
            covered.append(int(shown[:, left : left + width].sum()))
            left += width + 6
    for near in (covered[:4], covered[4:]):
        assert near == sorted(near, reverse=True)  # farther is smaller
        assert near[-1] >= 6
    assert len(DISTANCES_M) == len(WIDTHS_PX) == 4
    again = tmp_path / "again.jpg"
    write_contact_sheet(["suv", "quadrotor"], again)
    assert again.read_bytes() == out.read_bytes()


def test_invalid_names_and_unwritable_paths_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"'quadrotr'.* 'quadrotor'"):
        write_contact_sheet(["quadrotr"], tmp_path / "sheet.jpg")
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"file/sheet.jpg"):
        write_contact_sheet(["sign"], tmp_path / "file" / "sheet.jpg")


def test_the_documented_sheets_show_every_asset() -> None:
    text = (SHEETS / "README.md").read_text()
    drawn = re.findall(r"`dronecats episodes sheet --out docs/assets/([a-z-]+\.jpg) ([a-z_ -]+)`", text)
    shown = [name for _, row in drawn for name in row.split()]
    assert sorted(shown) == sorted(names())
    assert set(assets.names()) <= set(shown)
    sizes = []
    for file, row in drawn:
        picture = pictures.read(SHEETS / file)
        assert picture.shape[0] > len(row.split()) * HEIGHT_PX
        assert np.ptp(picture) > 200
        sizes.append((SHEETS / file).stat().st_size)
    assert sum(sizes) < 1_500_000
