"""The first picture that each drone of an episode takes."""

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import camera_pose
from episodes.camera.renderer.renderer import Renderer
from episodes.records.record import EpisodeRecord
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.frames import quat_from_euler

SUFFIXES = (".png", ".jpg", ".jpeg")


def first_frame(record: EpisodeRecord, camera: CameraModel) -> NDArray[np.uint8]:
    """Return what the camera sees at t = 0, (H, W, 3) RGB; of a fleet all its pictures, two beside each other."""
    world = World(record)
    renderer = Renderer(world.filmed, camera)
    views = []
    for drone, start in enumerate(record.starts):
        attitude = quat_from_euler(0.0, 0.0, math.radians(start.yaw_deg))
        moved = world.moved(0.0, world.fleet.others(drone))
        views.append(renderer.render(camera_pose(start.position_ned, attitude, camera), moved).rgb)
    renderer.close()
    if len(views) == 1:
        return views[0]
    if len(views) % 2:
        views.append(np.zeros_like(views[0]))
    return np.concatenate([np.concatenate(views[k : k + 2], axis=1) for k in range(0, len(views), 2)])


def write_first_frame(record: EpisodeRecord, file: Path) -> None:
    """Write the first frame, 1280 px wide, a fleet's 640 px each. Raises UsageError when it cannot be written there."""
    if file.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--picture wants a file that ends in {', '.join(SUFFIXES)}, not '{file.name[:60]}'.")
    camera = CameraModel() if len(record.starts) == 1 else CameraModel(640, 360)
    done, data = cv2.imencode(file.suffix.lower(), cv2.cvtColor(first_frame(record, camera), cv2.COLOR_RGB2BGR))
    if not done:
        raise UsageError(f"the picture '{file}' cannot be encoded.")
    try:
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise UsageError(f"the picture '{file}' cannot be written: {error.strerror}.") from None
