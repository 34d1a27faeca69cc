"""The map from above, drawn by the same renderer that draws the forward camera."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.renderer import Renderer
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import Vec3, quat_from_euler
from foundation.run_folder.reading import truth
from foundation.run_folder.rows import FrameTruth, Pose

Extent = tuple[float, float, float, float]  # north min, north max, east min, east max, m NED
HFOV_DEG = 20.0  # a long lens from high above: little parallax, so roofs stay over their houses
WIDTH_PX, HEIGHT_PX = 1600, 1000
MARGIN_M = 12.0


def aerial(world: World, folder: Path) -> tuple[NDArray[np.uint8], Extent]:
    """Return a picture (H, W, 3) RGB, north up, around everything that an episode's truth.jsonl mentions."""
    points = _mentioned(folder)
    points += [start.position_ned for start in world.record.starts] + [world.target_centre(0.0)]
    norths, easts = [p[0] for p in points], [p[1] for p in points]
    north, east = (min(norths) + max(norths)) / 2, (min(easts) + max(easts)) / 2
    high = (max(norths) - min(norths)) / 2 + MARGIN_M  # m, half the picture's height on the ground
    wide = max(high * WIDTH_PX / HEIGHT_PX, (max(easts) - min(easts)) / 2 + MARGIN_M)
    high = wide * HEIGHT_PX / WIDTH_PX
    camera = CameraModel(WIDTH_PX, HEIGHT_PX, HFOV_DEG, (0.0, 0.0, 0.0))
    height = wide / math.tan(math.radians(HFOV_DEG / 2))
    ground = world.ground_down(north, east)
    pose = CameraPose((north, east, ground - height), quat_from_euler(0.0, -math.pi / 2, 0.0))
    view = Renderer(world.scene, camera).render(pose, world.moved(0.0))
    return view.rgb, (north - high, north + high, east - wide, east + wide)


def _mentioned(folder: Path) -> list[Vec3]:
    """Return the places of drones and target, m NED; none where the log is damaged."""
    try:
        rows = [row for row in truth(folder) if isinstance(row, Pose | FrameTruth)]
    except UsageError:
        return []
    return [place for row in rows for place in (row.position_ned, row.target_ned) if place]
