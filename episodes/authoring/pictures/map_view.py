"""A picture of each map from where one sees what it is."""

import math
from pathlib import Path

import cv2

from episodes import maps
from episodes.camera.renderer.renderer import Renderer
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

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
