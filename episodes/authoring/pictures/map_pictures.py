"""Pictures of a map: from above, with the names that records use for native targets, and from a telling place."""

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from episodes.maps.scene import Scene
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

UNNAMED = ("ground", "wood", "shrub", "bush", "bollard", "fence", "hedge")  # too many, or nothing to fly to
SIDE_PX = 1800
Rect = tuple[int, int, int, int]  # px: left, top, right, bottom
HFOV_DEG = 12.0  # a long lens from high above: what stands leans outwards by less than its own width
MARGIN_M = 6.0
PALE = 0.42  # of white over the picture, so that the names stand out
QUALITY = 72


def map_plan(name: str, out: Path, seed: int = 1) -> None:
    """Write a JPEG, north up, of everything within the named things of a map; the same bytes each time.

    Raises UsageError for a name that is no map, or a file that cannot be written.
    """
    scene = maps.build(name, seed)
    named = [i for i in scene.instances if i.kind not in UNNAMED]
    places = np.array([i.position_ned[:2] for i in named] or [scene.spawn_ned[:2]])
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    half = float(np.ptp(places, axis=0).max()) / 2 + MARGIN_M
    picture = from_above(scene, float(middle[0]), float(middle[1]), half)
    picture = np.asarray(picture * (1.0 - PALE) + 255.0 * PALE, np.uint8)
    taken: list[Rect] = []
    for one in named:
        # left and top of the middle of the picture are west and north
        x = SIDE_PX / 2 + (one.position_ned[1] - middle[1]) / half * SIDE_PX / 2
        y = SIDE_PX / 2 - (one.position_ned[0] - middle[0]) / half * SIDE_PX / 2
        _label(picture, one.name, round(x), round(y), taken)
    data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    except OSError as error:
        raise UsageError(f"the picture '{out}' cannot be written: {error.strerror}.") from None


def from_above(scene: Scene, north: float, east: float, half: float, side_px: int = SIDE_PX) -> NDArray[np.uint8]:
    """Return the square (side_px, side_px, 3) RGB of ground around a place, north up, `half` metres to each side."""
    camera = CameraModel(side_px, side_px, HFOV_DEG, (0.0, 0.0, 0.0))
    height = half / math.tan(math.radians(HFOV_DEG / 2))
    eye = (north, east, scene.terrain.at(north, east) - height)
    renderer = Renderer(scene, camera)
    try:
        return renderer.render(CameraPose(eye, quat_from_euler(0.0, -math.pi / 2, 0.0))).rgb
    finally:
        renderer.close()


def _label(picture: NDArray[np.uint8], text: str, x: int, y: int, taken: list[Rect]) -> None:
    """Write a name beside its dot, where none of the names before it stands if there is such a place."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.36
    (wide, tall), _ = cv2.getTextSize(text, font, size, 1)
    around = ((5, 4), (-wide - 5, 4), (-wide // 2, -6), (-wide // 2, tall + 6), (5, -8), (5, tall + 8), (-wide - 5, -8))
    rects = [(x + dx, y + dy - tall, x + dx + wide, y + dy) for dx, dy in around]
    free = [r for r in rects if r[0] > 0 and r[2] < SIDE_PX and not any(_meet(r, other) for other in taken)]
    left, top, right, bottom = (free or rects)[0]
    taken.append((left, top, right, bottom))
    cv2.circle(picture, (x, y), 2, (170, 20, 20), -1, cv2.LINE_AA)
    cv2.putText(picture, text, (left, bottom), font, size, (255, 255, 255), 3, cv2.LINE_AA)
    cv2.putText(picture, text, (left, bottom), font, size, (20, 20, 24), 1, cv2.LINE_AA)


def _meet(a: Rect, b: Rect) -> bool:
    return a[0] < b[2] + 2 and b[0] < a[2] + 2 and a[1] < b[3] + 2 and b[1] < a[3] + 2


# map → north, east and height above the ground there in m, heading and pitch in degrees
VANTAGE: dict[str, tuple[float, float, float, float, float]] = {
    "blocks": (-46.0, -30.0, 9.0, 32.0, -9.0),
    "campus": (-17.0, -25.0, 6.5, 34.0, -6.0),
    "residential": (-40.0, 3.0, 11.0, 356.0, -12.0),
}
ABOVE_SPAWN = 12.0  # m, of the eye over the spawn point of a map that is not in VANTAGE
CAMERA = CameraModel(1280, 720, 90.0, (0.0, 0.0, 0.0))
LARGEST_BYTES = 250_000
QUALITIES = range(90, 40, -5)  # JPEG; the first that is small enough


def map_view(name: str, out: Path, seed: int = 1) -> None:
    """Write a JPEG of at most LARGEST_BYTES that shows a map; the same bytes each time.

    Raises UsageError for a name that is no map, or a file that cannot be written.
    """
    scene = maps.build(name, seed)
    n0, e0, _ = scene.spawn_ned
    default = (n0, e0, ABOVE_SPAWN, math.degrees(scene.spawn_yaw), -15.0)
    north, east, height, heading, pitch = VANTAGE.get(name, default)
    eye = (north, east, scene.terrain.at(north, east) - height)
    renderer = Renderer(scene, CAMERA)
    try:
        view = renderer.render(CameraPose(eye, quat_from_euler(0.0, math.radians(pitch), math.radians(heading))))
    finally:
        renderer.close()
    for quality in QUALITIES:
        settings = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
        data = cv2.imencode(".jpg", view.rgb[..., ::-1], settings)[1].tobytes()
        if len(data) <= LARGEST_BYTES:
            break
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    except OSError as error:
        raise UsageError(f"the picture '{out}' cannot be written: {error.strerror}.") from None
