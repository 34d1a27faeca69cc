"""The scene laid out for the kernels: one row per triangle, movable things last."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.render.pose import as_floats
from episodes.render.textures import Atlas, build_atlas
from episodes.scene import Instance, Material, Mesh, Moved, Scene
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


def lay_out(scene: Scene) -> SceneArrays:
    """Return `scene` as arrays. Raises UsageError for ids that repeat or are below 1, or a corner not finite."""
    ids = [instance.id for instance in scene.instances]
    if len(set(ids)) != len(ids) or min(ids, default=1) < 1:
        raise UsageError(
            f"map '{scene.name}' has instance ids that repeat or are below 1: number its instances from 1."
        )
    for name, mesh in {id(i.mesh): (i.name, i.mesh) for i in scene.instances}.values():
        if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all() and np.isfinite(mesh.uv).all()):
            raise UsageError(f"the mesh of '{name}' has a corner that is not finite: mend its vertices, normals or uv.")
    instances = sorted((i for i in scene.instances if len(i.mesh.triangles)), key=lambda i: i.movable)
    total = sum(len(instance.mesh.triangles) for instance in instances)
    triangles = Triangles(
        position=np.zeros((total, 3, 3), np.float32),
        normal=np.zeros((total, 3, 3), np.float32),
        uv=np.zeros((total, 3, 2), np.float32),
        face=np.zeros((total, 3), np.float32),
        flat=np.zeros(total, np.bool_),
        material=np.zeros(total, np.int32),
        instance=np.zeros(total, np.int32),
        plane=np.zeros(total, np.int32),
        chunk_first=np.array(_chunk_starts(instances), np.int32),
        chunk_count=np.zeros(0, np.int32),
        chunk_center=np.zeros((0, 3)),
        chunk_radius=np.zeros(0),
    )
    chunks = len(triangles.chunk_first)
    triangles = triangles._replace(
        chunk_count=np.diff(np.append(triangles.chunk_first, total)).astype(np.int32),
        chunk_center=np.zeros((chunks, 3)),
        chunk_radius=np.zeros(chunks),
    )
    materials: list[Material] = []
    row_of: dict[int, int] = {}
    planes: dict[int, NDArray[np.int32]] = {}
    movable: list[MovablePart] = []
    filled = first_chunk = static_count = plane_count = 0
    for instance in instances:
        mesh = instance.mesh
        rows = slice(filled, filled + len(mesh.triangles))
        filled = rows.stop
        chunk_rows = slice(first_chunk, first_chunk + math.ceil(len(mesh.triangles) / CHUNK))
        first_chunk = chunk_rows.stop
        for material in mesh.materials:
            if id(material) not in row_of:
                row_of[id(material)] = len(materials)
                materials.append(material)
        position, face = mesh.vertices[mesh.triangles], face_normals(mesh)
        part = MovablePart(instance, rows, chunk_rows, position, mesh.normals[mesh.triangles], face)
        place(triangles, part, instance.position_ned, instance.yaw)
        uv = mesh.uv[mesh.triangles]
        triangles.uv[rows] = uv - np.floor(uv.min(axis=1, keepdims=True))  # small numbers keep their precision
        triangles.flat[rows] = (np.ptp(part.normal, axis=1) < 1e-6).all(axis=1)
        triangles.material[rows] = np.array([row_of[id(m)] for m in mesh.materials], np.int32)[mesh.material]
        triangles.instance[rows] = instance.id
        if id(mesh) not in planes:
            planes[id(mesh)] = _flat_pieces(mesh, position, face)
        triangles.plane[rows] = planes[id(mesh)] + plane_count
        plane_count += int(planes[id(mesh)].max()) + 1
        if instance.movable:
            movable.append(part)
        else:
            static_count = filled
    surfaces, atlas = _surfaces(materials)
    return SceneArrays(triangles, surfaces, atlas, tuple(movable), static_count)


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
    first = part.triangles.start
    for chunk in range(part.chunks.start, part.chunks.stop):
        start = int(triangles.chunk_first[chunk]) - first
        corners = position[start : start + int(triangles.chunk_count[chunk])].reshape(-1, 3)
        center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        triangles.chunk_center[chunk] = center
        triangles.chunk_radius[chunk] = np.sqrt(((corners - center) ** 2).sum(axis=1).max()) * 1.0001 + 1e-3


def place_all(layout: SceneArrays, moved: Moved) -> list[MovablePart]:
    """Put every movable instance at its pose in `moved`, or where the scene has it, and return those that are there.

    Raises UsageError when `moved` names an instance that the scene lacks or that is not movable.
    """
    known = {part.instance.id for part in layout.movable}
    if unknown := sorted(set(moved) - known):
        raise UsageError(f"instance {unknown[0]} cannot be moved: the scene's movable instances are {sorted(known)}.")
    there = []
    for part in layout.movable:
        at = moved.get(part.instance.id, (part.instance.position_ned, part.instance.yaw))
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


def _flat_pieces(mesh: Mesh, position: NDArray[np.float32], face: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return for each triangle a number shared by those with its material and its plane."""
    offset = np.einsum("ij,ij->i", position[:, 0].astype(np.float64), face)
    key = np.column_stack((mesh.material, np.rint(face * 16.0), np.rint(offset * 8.0)))
    return np.unique(key, axis=0, return_inverse=True)[1].ravel().astype(np.int32)


def _chunk_starts(instances: list[Instance]) -> list[int]:
    """Return the first triangle of each chunk; a chunk never spans two instances."""
    starts: list[int] = []
    filled = 0
    for instance in instances:
        starts.extend(range(filled, filled + len(instance.mesh.triangles), CHUNK))
        filled += len(instance.mesh.triangles)
    return starts


def _surfaces(materials: list[Material]) -> tuple[Surfaces, Atlas]:
    """Return the table of materials and the atlas of their textures, each picture stored once."""
    pictures: list[NDArray[np.uint8]] = []
    texture_of: dict[int, int] = {}
    for material in materials:
        if material.texture is not None and id(material.texture) not in texture_of:
            texture_of[id(material.texture)] = len(pictures)
            pictures.append(material.texture)
    surfaces = Surfaces(
        color=np.array([m.color for m in materials], np.float32).reshape(-1, 3).clip(0.0),
        emission=np.array([m.emission for m in materials], np.float32),
        specular=np.array([m.specular for m in materials], np.float32),
        texture=np.array([texture_of.get(id(m.texture), -1) for m in materials], np.int32),
    )
    return surfaces, build_atlas(pictures)
