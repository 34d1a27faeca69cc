"""Contact sheets: every asset from near and far, alone on level ground, in the very pixels that a model is given."""

import difflib
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets
from episodes.maps import geometry as g
from episodes.maps.assets import fixtures, scenery
from episodes.maps.assets.materials import surface
from episodes.maps.assets.multirotor import X500, multirotor
from episodes.maps.scene import Instance, Mesh, Scene, Sun
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler
from foundation.terrain import FLAT

GROUND_M = 160.0  # half the ground's width


def alone(name: str, mesh: Mesh, sun: Sun, height_m: float = 0.0) -> Scene:
    """Return the scene: the asset in the middle, its origin `height_m` above asphalt, facing north under the sun."""
    corner = [(GROUND_M * x, GROUND_M * y, 0.0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    flat = g.soup([[corner[i] for i in (0, 1, 2)], [corner[i] for i in (0, 2, 3)]], surface("asphalt"), tile_m=4.0)
    ground = Instance(1, "ground", "ground", g.assemble([flat]), (0.0, 0.0, 0.0))
    return Scene("studio", (ground, Instance(2, name, name, mesh, (0.0, 0.0, -height_m))), FLAT, sun, 47.0, 8.0, 400.0)


DISTANCES_M = (6.0, 12.0, 24.0, 48.0)  # from the camera to the edge of the asset's box, towards its middle
WIDTHS_PX = (448, 320, 192, 128)  # of each distance's tile, cut from the middle of the picture
HEIGHT_PX, LABEL_PX, GAP_PX = 248, 26, 6
EYE_M = 1.6  # above the ground
QUARTER_DEG = 35.0  # which way the camera stands off the asset's nose, to the right
FRAME = CameraModel(1280, 720, 90.0, (0.0, 0.0, 0.0))
SEEN_PX = (640, 360)  # of the reduced frame
SHADE = Sun((0.22, 0.62, -0.753))  # over the viewer's shoulder
PAINTS = ("cyan", "red", "yellow", "green", "orange", "blue", "purple", "pink")  # in turn, row by row
INSCRIPTIONS = {"sign": "GATE 7"}
DRONE, HOVER_M = "drone", 1.3  # of a fleet, which no record names; above the ground
QUALITY = 80
INK, PAGE = (36, 38, 42), (246, 246, 244)

Picture = NDArray[np.uint8]


def names() -> list[str]:
    """Return all that can be shown: the assets of episodes, campus fixtures, what stands along streets, and a drone."""
    return [*assets.names(), *sorted(fixtures.MAKERS), *sorted(scenery.MAKERS), DRONE]


def contact_sheet(chosen: Sequence[str], out: Path) -> None:
    """Write a JPEG with one row per asset (all of them when none is chosen) and one column per distance.

    Each tile is cut from the forward camera's 1280×720 frame after its reduction to 640 px, pixel for pixel. The same
    names give the same bytes. Raises UsageError for a name that is not among `names()`, or for a file that
    cannot be written.
    """
    known = names()
    for name in chosen:
        if name not in known:
            near = ", ".join(difflib.get_close_matches(name, known, 3, 0.3) or known)
            raise UsageError(f"asset '{name}' is not in the catalogue: did you mean {near}?")
    rows = [_row(name, PAINTS[k % len(PAINTS)]) for k, name in enumerate(chosen or known)]
    rgb = np.concatenate([_header(), *rows])
    data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1])[1]
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data.tobytes())
    except OSError as error:
        raise UsageError(f"the contact sheet '{out}' cannot be written: {error.strerror}.") from None


def _mesh(name: str, paint: str) -> Mesh:
    if name in assets.names():
        return assets.build(name, paint, INSCRIPTIONS.get(name))
    if name == DRONE:
        return multirotor(X500)
    return (fixtures.MAKERS.get(name) or scenery.MAKERS[name])()


def _row(name: str, paint: str) -> Picture:
    """Return the tiles of one asset side by side, its name above the first."""
    mesh = _mesh(name, paint)
    renderer = Renderer(alone(name, mesh, SHADE, HOVER_M if name == DRONE else 0.0), FRAME, shadow_cells=2048)
    turn = math.radians(QUARTER_DEG)
    ahead, right = mesh.vertices[:, :2].max(axis=0).astype(float)
    reach = min(ahead / math.cos(turn), right / math.sin(turn))
    tiles = []
    try:
        for distance, width in zip(DISTANCES_M, WIDTHS_PX, strict=True):
            away = reach + distance
            eye = (away * math.cos(turn), away * math.sin(turn), -EYE_M)
            view = renderer.render(CameraPose(eye, quat_from_euler(0.0, 0.0, turn + math.pi)))
            seen = cv2.resize(view.rgb, SEEN_PX, interpolation=cv2.INTER_AREA)
            left, top = (SEEN_PX[0] - width) // 2, (SEEN_PX[1] - HEIGHT_PX) // 2
            tiles.append(_framed(seen[top : top + HEIGHT_PX, left : left + width]))
    finally:
        renderer.close()
    label = f"{name}, {paint}" if name in assets.names() else name
    return np.concatenate([_caption(label, sum(t.shape[1] for t in tiles)), np.concatenate(tiles, axis=1)])


def _framed(tile: Picture) -> Picture:
    return np.asarray(np.stack([np.pad(tile[..., k], GAP_PX // 2, constant_values=PAGE[k]) for k in range(3)], axis=2))


def _caption(text: str, width: int, at: int = GAP_PX) -> Picture:
    strip = np.full((LABEL_PX, width, 3), PAGE, np.uint8)
    cv2.putText(strip, text, (at, LABEL_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.55, INK, 1, cv2.LINE_AA)
    return strip


def _header() -> Picture:
    """Return the line that says how far away each column is."""
    heads = [_caption(f"{d:g} m", w + GAP_PX) for d, w in zip(DISTANCES_M, WIDTHS_PX, strict=True)]
    return np.concatenate(heads, axis=1)
