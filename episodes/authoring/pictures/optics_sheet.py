"""One place under every camera option: `dronecats episodes optics FILE.jpg`."""

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.optics.camera import OpticalRenderer, VehicleMotion
from episodes.camera.optics.options import Exposure, Haze, LensModel, Optics, Rain, Sensor, SunPlace
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

SHOWN: dict[str, Optics] = {
    "all off": Optics(),
    "lens: k1 -0.25, vignetting 1": Optics(lens=LensModel(k1=-0.25, k2=0.05, vignetting=1.0)),
    "sensor: 300 e, read 12 e": Optics(sensor=Sensor(300.0, 12.0)),
    "exposure: 50 ms at 1 m/s, 60 deg/s": Optics(exposure=Exposure(0.05, 12)),
    "sun: hour 18.5": Optics(sun=SunPlace(hour=18.5)),
    "haze: 0.02 per m": Optics(haze=Haze(0.02)),
    "rain: 40 mm/h": Optics(rain=Rain(40.0)),
    "haze, rain, lens, noise": Optics(
        LensModel(k1=-0.2, k2=0.03, vignetting=0.7),
        Sensor(2000.0, 8.0),
        Exposure(0.008, 2),
        haze=Haze(0.01),
        rain=Rain(20.0),
    ),
}
TILE_PX, COLUMNS, LABEL_PX, QUALITY = (480, 270), 2, 24, 82


def tile(name: str, optics: Optics, world: World) -> NDArray[np.uint8]:
    """Return one labelled picture from the episode's start, (H, W, 3) RGB."""
    start = world.record.starts[0]
    turning = name.startswith("exposure")
    motion = VehicleMotion(
        time_s=0.0,
        position_ned=start.position_ned,
        velocity_ned=(1.0, 0.0, 0.0),
        attitude=quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg)),
        rates_frd=(0.0, 0.0, math.radians(60.0) if turning else 0.0),
    )
    renderer = OpticalRenderer(world.scene, CameraModel(), optics)
    picture = cv2.resize(renderer.picture(motion, world.moved, (1,)), TILE_PX, interpolation=cv2.INTER_AREA)
    renderer.close()
    label = np.full((LABEL_PX, TILE_PX[0], 3), 246, np.uint8)
    cv2.putText(label, name, (6, LABEL_PX - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (36, 38, 42), 1, cv2.LINE_AA)
    return np.concatenate((label, picture))


def write(file: Path, episode: str | None = None) -> None:
    """Write the sheet as JPEG. Raises UsageError where it cannot be written."""
    world = World(catalogue.load(episode or catalogue.DEFAULT))
    tiles = [tile(name, optics, world) for name, optics in SHOWN.items()]
    rows = [np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)]
    sheet = np.concatenate(rows)[..., ::-1]
    data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_OPTIMIZE, 1])[1]
    try:
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise UsageError(f"the picture '{file}' cannot be written: {error.strerror}.") from None
