"""The scene as the kernels take it: one row per triangle, movable things last."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.pose import as_floats
from episodes.camera.renderer.textures import Atlas
from episodes.maps.scene import Instance, Mesh, Moved
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, rotate

CHUNK = 128  # triangles that are accepted or rejected together
AXES: tuple[Vec3, Vec3, Vec3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Triangles(NamedTuple):
    """Every triangle of the scene, in NED, with the chunks by which they are culled."""

    position: NDArray[np.float32]  # (T, 3, 3) m, NED, corner by corner
    normal: NDArray[np.float32]  # (T, 3, 3) unit, NED, at the corners
    uv: NDArray[np.float32]  # (T, 3, 2)
    face: NDArray[np.float32]  # (T, 3) unit, NED, of the plane, on the side from which corners run counter-clockwise
    flat: NDArray[np.bool_]  # (T,) the normals at the corners are equal
    material: NDArray[np.int32]  # (T,) row of Surfaces
    instance: NDArray[np.int32]  # (T,) the instance's id
    plane: NDArray[np.int32]  # (T,) equal for triangles of one flat, uniform piece: no edge is smoothed between them
    chunk_first: NDArray[np.int32]  # (C,) first triangle
    chunk_count: NDArray[np.int32]  # (C,)
    chunk_center: NDArray[np.float64]  # (C, 3) m, NED, of a sphere around the chunk
    chunk_radius: NDArray[np.float64]  # (C,) m


class Surfaces(NamedTuple):
    """Every material of the scene."""

    color: NDArray[np.float32]  # (M, 3) linear
    emission: NDArray[np.float32]  # (M,)
    specular: NDArray[np.float32]  # (M,)
    texture: NDArray[np.int32]  # (M,) texture of the atlas, -1 = none


@dataclass(frozen=True)
class MovablePart:
    """The rows of Triangles and Triangles.chunk_* that belong to one movable instance, and its shape at rest."""

    instance: Instance
    triangles: slice
    chunks: slice
    position: NDArray[np.float32]  # (n, 3, 3) m, FRD of the asset
    normal: NDArray[np.float32]  # (n, 3, 3) FRD of the asset
    face: NDArray[np.float32]  # (n, 3) FRD of the asset


@dataclass(frozen=True)
class SceneArrays:
    """A scene ready for the kernels."""

    triangles: Triangles
    surfaces: Surfaces
    atlas: Atlas
    movable: tuple[MovablePart, ...]
    static_count: int  # the triangles that never move are the first ones


def place(triangles: Triangles, part: MovablePart, position_ned: Vec3, turned: float | Quat) -> None:
    """Write the corners of one instance at `position_ned` (m) into `triangles`, by its yaw (rad) or its attitude."""
    if isinstance(turned, tuple):
        turn = np.array([rotate(turned, axis) for axis in AXES])  # row vectors: v @ turn
    else:
        c, s = math.cos(turned), math.sin(turned)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    position = part.position @ turn + np.array(as_floats(position_ned))
    triangles.position[part.triangles] = position
    triangles.normal[part.triangles] = part.normal @ turn
    triangles.face[part.triangles] = part.face @ turn
    starts = triangles.chunk_first[part.chunks] - part.triangles.start
    low, high = np.minimum.reduceat(position.min(axis=1), starts), np.maximum.reduceat(position.max(axis=1), starts)
    center = 0.5 * (low + high)
    away = position - np.repeat(center, triangles.chunk_count[part.chunks], axis=0)[:, None]
    far = np.maximum.reduceat((away**2).sum(axis=2).max(axis=1), starts)
    triangles.chunk_center[part.chunks] = center
    triangles.chunk_radius[part.chunks] = np.sqrt(far) * 1.0001 + 1e-3


def place_all(layout: SceneArrays, moved: Moved) -> list[MovablePart]:
    """Put every movable instance at its pose in `moved`, or where the scene has it, and return those that are there.

    Raises UsageError when `moved` names an instance that the scene lacks or that is not movable.
    """
    known = {part.instance.id for part in layout.movable}
    if unknown := sorted(set(moved) - known):
        raise UsageError(f"instance {unknown[0]} cannot be moved: the scene's movable instances are {sorted(known)}.")
    there = []
    for part in layout.movable:
        at = moved.get(part.instance.id, (part.instance.position_ned, part.instance.turned))
        if at is None:
            layout.triangles.chunk_radius[part.chunks] = -np.inf  # in nobody's view
        else:
            place(layout.triangles, part, *at)
            there.append(part)
    return there


def face_normals(mesh: Mesh) -> NDArray[np.float32]:
    """Return the (T, 3) unit normals of the triangles' planes, from the order of their corners."""
    corner = mesh.vertices[mesh.triangles].astype(np.float64)
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.where(length > 0.0, cross / np.maximum(length, 1e-30), (0.0, 0.0, -1.0)).astype(np.float32)
