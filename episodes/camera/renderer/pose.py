"""From the pose of a vehicle to the pose of its camera, and from there to what the kernels need."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, rotate

NEAR_M = 0.05  # nothing closer along the optical axis is drawn


class Eye(NamedTuple):
    """A camera as the kernels see it.

    A position (x, y) in px looks along `forward + (x - center_x) / focal · right + (y - center_y) / focal · down`,
    whose component along the optical axis is one: a multiple of it *is* the planar depth.
    """

    position: Vec3  # m, NED, optical centre
    forward: Vec3  # unit, NED
    right: Vec3  # unit, NED
    down: Vec3  # unit, NED
    focal: float  # px
    center_x: float  # px, W / 2
    center_y: float  # px, H / 2


def camera_pose(position_ned: Vec3, attitude: Quat, camera: CameraModel) -> CameraPose:
    """Return where the camera of a vehicle is.

    `position_ned` (m) is the body origin and `attitude` rotates body FRD into NED; the camera sits at
    `camera.offset_frd` and looks along body forward (zero pitch), so its attitude is the body's.
    """
    offset = rotate(attitude, camera.offset_frd)
    position = (position_ned[0] + offset[0], position_ned[1] + offset[1], position_ned[2] + offset[2])
    return CameraPose(position_ned=position, attitude=attitude)


def eye_of(pose: CameraPose, camera: CameraModel) -> Eye:
    """Return `pose` with its axes in NED and the pinhole of `camera`. Source: paper, "Back-projection"."""
    return Eye(
        position=as_floats(pose.position_ned),
        forward=rotate(pose.attitude, (1.0, 0.0, 0.0)),
        right=rotate(pose.attitude, (0.0, 1.0, 0.0)),
        down=rotate(pose.attitude, (0.0, 0.0, 1.0)),
        focal=float(camera.focal_px),
        center_x=0.5 * camera.width,
        center_y=0.5 * camera.height,
    )


def depth_per_metre(camera: CameraModel) -> NDArray[np.float32]:
    """Return (H, W): how far a metre along each pixel's ray reaches along the optical axis (its cosine)."""
    x = (np.arange(camera.width) + 0.5 - 0.5 * camera.width) / camera.focal_px
    y = (np.arange(camera.height) + 0.5 - 0.5 * camera.height) / camera.focal_px
    return (1.0 / np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)).astype(np.float32)


def as_floats(v: Vec3) -> Vec3:
    """Return `v` as three Python floats, so that a kernel is compiled for one kind of number only."""
    x, y, z = (float(component) for component in v)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise UsageError(f"a position in the scene must be finite, not {v}: give metres north, east and down.")
    return (x, y, z)
