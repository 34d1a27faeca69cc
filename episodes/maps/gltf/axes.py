"""Between glTF's axes (+X right, +Y up, −Z ahead) and ours (north or forward, east or right, down). Metres both."""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

_F = TypeVar("_F", np.float32, np.float64)

# ours = AXES @ glTF's; a rotation, so what is wound counter-clockwise stays so
AXES = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def from_gltf(xyz: NDArray[_F]) -> NDArray[_F]:
    """Return vectors (…, 3) in our axes; signs and order change only, so the numbers stay exact."""
    turned: NDArray[_F] = np.stack([-xyz[..., 2], xyz[..., 0], -xyz[..., 1]], axis=-1) + xyz.dtype.type(
        0
    )  # + 0: no negative zeros
    return turned


def to_gltf(frd: NDArray[_F]) -> NDArray[_F]:
    """Return vectors (…, 3) in glTF's axes, exactly."""
    turned: NDArray[_F] = np.stack([frd[..., 1], -frd[..., 2], -frd[..., 0]], axis=-1) + frd.dtype.type(0)
    return turned


def linear_from_gltf(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a (3, 3) linear map of glTF's axes as the same map of ours."""
    return np.asarray(AXES @ matrix @ AXES.T)


def quaternion_of(yaw: float) -> list[float]:
    """Return glTF's (x, y, z, w) of a turn by `yaw` (rad, clockwise from above): counter-clockwise about +Y."""
    return [0.0, -math.sin(yaw / 2) + 0.0, 0.0, math.cos(yaw / 2)]
