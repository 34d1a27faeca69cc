"""Which pixels of a picture show the target: rays through the middle of each, as the renderer's ids have it."""

import math
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from episodes.maps.scene import Instance, Mesh
from episodes.world.visibility import NEAR_M, Hides, turn
from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, rotate
from foundation.threads import once

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Patch:
    """Where the target is in a picture."""

    pixels: int  # that show it
    share: float  # 0 … 1 of the picture's pixels
    box_share: float  # 0 … 1 of the picture covered by the box around those pixels
    cut: bool = False  # whether they reach an edge of the picture


NOTHING = Patch(0, 0.0, 0.0)


def patch(
    target: Instance,
    place: Vec3,
    turned: float | Quat,
    solids: Hides,
    origin: Vec3,
    attitude: Quat,
    camera: CameraModel,
) -> Patch:
    """Return where a target standing at `place` turned so is in the picture of a drone at `origin` (m, NED)."""
    axes = np.array([rotate(attitude, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])
    eye = np.array(origin) + np.array(rotate(attitude, camera.offset_frd))
    to_world = turn(turned)
    across, down = _reach(target, np.array(place), to_world, eye, axes, camera)
    if len(across) == 0 or len(down) == 0:
        return NOTHING
    x = (across + 0.5 - camera.width / 2) / camera.focal_px
    y = (down + 0.5 - camera.height / 2) / camera.focal_px
    way = (axes[0] + x[None, :, None] * axes[1] + y[:, None, None] * axes[2]).reshape(-1, 3)
    own = _traced(target.mesh)
    local_eye = ((eye - np.array(place)) @ to_world).astype(np.float32)
    start = np.ascontiguousarray(np.broadcast_to(local_eye, way.shape))
    hit = own.run(start, np.ascontiguousarray((way @ to_world).astype(np.float32)), output=1)
    met = np.flatnonzero((hit["primID"] >= 0) & (hit["tfar"] > NEAR_M))
    if len(met):
        points = eye + way[met] * hit["tfar"][met, None].astype(np.float64)
        met = met[~solids.hidden((float(eye[0]), float(eye[1]), float(eye[2])), points)]
    if len(met) == 0:
        return NOTHING
    row, column = np.divmod(met, len(across))
    box = (int(np.ptp(row)) + 1) * (int(np.ptp(column)) + 1)
    whole = camera.width * camera.height
    edges = {int(across[column].min()), int(across[column].max()) + 1 - camera.width}
    edges |= {int(down[row].min()), int(down[row].max()) + 1 - camera.height}
    return Patch(len(met), len(met) / whole, box / whole, cut=0 in edges)


@once(16)  # a record's checks and a search for places ask about the same few things over and over
def _traced(mesh: Mesh) -> EmbreeScene:
    """Return a mesh for rays, in the asset's axes."""
    scene = EmbreeScene()
    corners = np.ascontiguousarray(mesh.vertices[mesh.triangles].reshape(-1, 3), dtype=np.float32)
    TriangleMesh(scene, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    return scene


def _reach(
    target: Instance, place: Array, to_world: Array, eye: Array, axes: Array, camera: CameraModel
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the columns and the rows of the picture that the target's box can be in."""
    low, high = target.mesh.vertices.min(axis=0), target.mesh.vertices.max(axis=0)
    corners = np.array([[(low, high)[k >> b & 1][b] for b in range(3)] for k in range(8)], dtype=np.float64)
    seen = (corners @ to_world.T + place - eye) @ axes.T
    if (seen[:, 0] <= NEAR_M).all():
        return np.arange(0), np.arange(0)
    if (seen[:, 0] <= NEAR_M).any():  # partly behind the lens: it may be anywhere
        return np.arange(camera.width), np.arange(camera.height)
    x = camera.width / 2 + camera.focal_px * seen[:, 1] / seen[:, 0]
    y = camera.height / 2 + camera.focal_px * seen[:, 2] / seen[:, 0]
    return _span(x, camera.width), _span(y, camera.height)


def _span(values: Array, size: int) -> NDArray[np.int64]:
    return np.arange(max(math.floor(values.min()), 0), min(math.ceil(values.max()) + 1, size))
