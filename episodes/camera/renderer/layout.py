"""Prepares the arrays of a scene for the compiled kernels: the camera's pose, and one row per triangle.

The rows of a map are computed once. Instances that a scene adds to its map get rows after the map's rows. The rows of
movable instances are last.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.textures import Atlas, build_atlas
from episodes.maps.cutouts import OPAQUE, Cutouts, cutouts_of, distinct, is_cut_out
from episodes.maps.geometry import connected
from episodes.maps.scene import Instance, Material, Mesh, Moved, Scene, kept_of_scene, turn
from foundation.camera import CameraModel, CameraPose
from foundation.errors import UsageError
from foundation.frames import Quat, Vec3, rotate
from foundation.threads import once

NEAR_M = 0.05  # nothing closer along the optical axis is drawn

SOURCES = ("episodes/camera/renderer/*.py", "episodes/maps/*.py", "foundation/*.py")  # cached values depend on these
CHUNK = 128  # largest number of triangles that are culled together


class Eye(NamedTuple):
    """The pose and the pinhole of a camera, for the kernels.

    The ray through (x, y) in px has the direction
    `forward + (x - center_x) / focal · right + (y - center_y) / focal · down`. This direction is not a unit vector: its
    component along the optical axis is 1. So direction × planar depth is the vector from the camera to a point.
    """

    position: Vec3  # m, NED, optical centre
    forward: Vec3  # unit, NED
    right: Vec3  # unit, NED
    down: Vec3  # unit, NED
    focal: float  # px
    center_x: float  # px, W / 2
    center_y: float  # px, H / 2
    grain: int  # samples per pixel in each direction, even


def eye_of(pose: CameraPose, camera: CameraModel, grain: int = 2) -> Eye:
    """Return the eye at `pose` with the pinhole of `camera`. Source: paper, "Back-projection"."""
    return Eye(
        position=as_floats(pose.position_ned),
        forward=rotate(pose.attitude, (1.0, 0.0, 0.0)),
        right=rotate(pose.attitude, (0.0, 1.0, 0.0)),
        down=rotate(pose.attitude, (0.0, 0.0, 1.0)),
        focal=float(camera.focal_px),
        center_x=0.5 * camera.width,
        center_y=0.5 * camera.height,
        grain=grain,
    )


def as_floats(v: Vec3) -> Vec3:
    """Return `v` as three Python floats, so that kernels are compiled for one type. Raises UsageError if not finite."""
    x, y, z = (float(component) for component in v)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise UsageError(f"a position in the scene must be finite, not {v}: give metres north, east and down.")
    return (x, y, z)


class Triangles(NamedTuple):
    """All triangles of the scene, in NED, and the chunks of triangles that are culled together."""

    position: NDArray[np.float32]  # (T, 3, 3) m, NED, corners
    normal: NDArray[np.float32]  # (T, 3, 3) unit, NED, at the corners
    uv: NDArray[np.float32]  # (T, 3, 2)
    face: NDArray[np.float32]  # (T, 3) unit normal, NED; seen from its tip, the corners run counter-clockwise
    flat: NDArray[np.bool_]  # (T,) whether the normals at the corners are equal
    material: NDArray[np.int32]  # (T,) row of Surfaces
    instance: NDArray[np.int32]  # (T,) the instance's id
    plane: NDArray[np.int32]  # (T,) number of the flat piece (`_flat_pieces`); edges inside a piece are not smoothed
    solid: NDArray[np.int8]  # (T,) 1: `face` points out of a closed surface; -1: into it; 0: the surface is open
    cutout: NDArray[np.int32]  # (T,) row of Cutouts; OPAQUE for a triangle without holes
    chunk_first: NDArray[np.int32]  # (C,) first triangle
    chunk_count: NDArray[np.int32]  # (C,)
    chunk_center: NDArray[np.float64]  # (C, 3) m, NED, middle of a sphere around the chunk
    chunk_radius: NDArray[np.float64]  # (C,) m
    chunk_cut: NDArray[np.bool_]  # (C,) whether the textures of the chunk have holes (all of them or none)
    solid_center: NDArray[np.float64]  # (C, 3) m, NED, middle of a sphere around the surfaces that the chunk belongs to
    solid_radius: NDArray[np.float64]  # (C,) m; from outside the sphere, a camera sees no back faces of closed surfaces


BY_CHUNK = ("chunk_first", "chunk_count", "chunk_center", "chunk_radius", "chunk_cut", "solid_center", "solid_radius")


class Surfaces(NamedTuple):
    """All materials of the scene."""

    color: NDArray[np.float32]  # (M, 3) linear
    emission: NDArray[np.float32]  # (M,)
    specular: NDArray[np.float32]  # (M,)
    texture: NDArray[np.int32]  # (M,) index of the texture in the atlas, -1 = none
    drift: NDArray[np.float32]  # (M,) share by which the tone varies over the ground; 0: constant
    foliage: NDArray[np.bool_]  # (M,)


@dataclass(frozen=True)
class PlacedPart:
    """The rows of Triangles that belong to one instance, and its shape in the axes of the asset."""

    instance: Instance
    triangles: slice  # rows of the fields that are not in BY_CHUNK
    chunks: slice  # rows of the fields in BY_CHUNK
    shape: "LaidMesh"


@dataclass(frozen=True)
class SceneArrays:
    """All arrays of a scene that the kernels need."""

    triangles: Triangles
    surfaces: Surfaces
    atlas: Atlas
    cutouts: Cutouts
    movable: tuple[PlacedPart, ...]
    static_count: int  # number of triangles that never move; they are the first ones


def place(triangles: Triangles, part: PlacedPart, position_ned: Vec3, turned: float | Quat) -> None:
    """Write one instance into `triangles`. `position_ned`: m; `turned`: yaw (rad) or attitude."""
    axes = np.ascontiguousarray(turn(turned).T)  # row vectors: v @ axes
    position = part.shape.position @ axes + np.array(as_floats(position_ned))
    triangles.position[part.triangles] = position
    triangles.normal[part.triangles] = part.shape.normal @ axes
    triangles.face[part.triangles] = part.shape.face @ axes
    starts = triangles.chunk_first[part.chunks] - part.triangles.start
    low, high = np.minimum.reduceat(position.min(axis=1), starts), np.maximum.reduceat(position.max(axis=1), starts)
    center = 0.5 * (low + high)
    away = position - np.repeat(center, triangles.chunk_count[part.chunks], axis=0)[:, None]
    far = np.maximum.reduceat((away**2).sum(axis=2).max(axis=1), starts)
    triangles.chunk_center[part.chunks] = center
    triangles.chunk_radius[part.chunks] = np.sqrt(far) * 1.0001 + 1e-3
    triangles.solid_center[part.chunks] = part.shape.solid_center @ axes + np.array(as_floats(position_ned))


def place_all(layout: SceneArrays, moved: Moved) -> list[PlacedPart]:
    """Put every movable instance at its pose in `moved`, or hide it if the pose is None. Return the instances to draw.

    An instance without an entry gets its pose from the scene. Raises UsageError when `moved` names an instance that the
    scene lacks or that is not movable.
    """
    ids = {part.instance.id for part in layout.movable}
    if unknown := sorted(set(moved) - ids):
        raise UsageError(f"instance {unknown[0]} cannot be moved: the scene's movable instances are {sorted(ids)}.")
    drawn = []
    for part in layout.movable:
        at = moved.get(part.instance.id, (part.instance.position_ned, part.instance.turned))
        if at is None:
            layout.triangles.chunk_radius[part.chunks] = -np.inf  # outside every view
        else:
            place(layout.triangles, part, *at)
            drawn.append(part)
    return drawn


def face_normals(mesh: Mesh) -> NDArray[np.float32]:
    """Return the (T, 3) unit normals of the triangles' planes, directed by the order of the corners."""
    corner = mesh.vertices[mesh.triangles].astype(np.float64)
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return np.where(length > 0.0, cross / np.maximum(length, 1e-30), (0.0, 0.0, -1.0)).astype(np.float32)


@dataclass(frozen=True)
class SceneLayout:
    """The arrays of a scene, and the state that is needed to add instances.

    Materials, textures and meshes are compared by identity.
    """

    arrays: SceneArrays
    materials: tuple[Material, ...] = ()  # the rows of Surfaces
    pictures: tuple[NDArray[np.uint8], ...] = ()  # the textures of the atlas
    planes: Mapping[Mesh, NDArray[np.int32]] = field(default_factory=dict)  # `_flat_pieces` of each mesh
    plane_count: int = 0


def lay_out(scene: Scene, of_map: SceneLayout | None = None) -> SceneArrays:
    """Return the arrays of a scene.

    `of_map`, the layout of the scene's map, only saves time: its rows are copied instead of computed.
    Raises UsageError for ids that repeat or are below 1, and for a corner that is not finite.
    """
    ids = [instance.id for instance in scene.instances]
    if len(set(ids)) != len(ids) or min(ids, default=1) < 1:
        raise UsageError(
            f"map '{scene.name}' has instance ids that repeat or are below 1: number its instances from 1."
        )
    if scene.base and of_map:
        return add_instances(of_map, scene.instances[len(scene.base.instances) :]).arrays
    return add_instances(NOTHING, scene.instances).arrays


@once(3)  # the episodes and cameras of a run share the layout
def map_layout(scene: Scene) -> SceneLayout | None:
    """Return the layout of a map, for `lay_out`; None if the map has movable instances (their rows must stay last)."""
    if any(instance.movable for instance in scene.instances):
        return None
    rows = kept_of_scene("layout", SOURCES, scene, lambda: _with_instances(NOTHING, scene.instances))
    return _layout_of(NOTHING, scene.instances, rows)


def add_instances(laid: SceneLayout, instances: Sequence[Instance]) -> SceneLayout:
    """Return a layout with these instances added. Raises UsageError for a corner that is not finite."""
    return _layout_of(laid, instances, _with_instances(laid, instances))


class _Rows(NamedTuple):
    """The rows of a layout and of added instances. They can be stored in a file if no instance is movable."""

    triangles: Triangles  # `cutout` is not yet filled
    planes: list[NDArray[np.int32]]  # `_flat_pieces` of each mesh, in the order of `_meshes`
    plane_count: int
    movable: tuple[PlacedPart, ...]
    static_count: int


def _layout_of(laid: SceneLayout, instances: Sequence[Instance], rows: _Rows) -> SceneLayout:
    """Return `laid` with `instances` added; `rows` are the rows of the result."""
    materials = _materials(laid, instances)
    surfaces, pictures = _surfaces(materials)
    cutouts, cutout_of = cutouts_of(materials)
    triangles = rows.triangles
    triangles.cutout[:] = cutout_of[triangles.material] if materials else OPAQUE
    atlas = build_atlas(pictures[len(laid.pictures) :], laid.arrays.atlas)
    arrays = SceneArrays(triangles, surfaces, atlas, cutouts, rows.movable, rows.static_count)
    planes = dict(zip(_meshes(laid, instances), rows.planes, strict=True))
    return SceneLayout(arrays, tuple(materials), tuple(pictures), planes, rows.plane_count)


def _in_order(instances: Sequence[Instance]) -> list[Instance]:
    """Return the instances that have triangles, in the order of their rows: the movable ones are last."""
    return sorted((i for i in instances if len(i.mesh.triangles)), key=lambda i: i.movable)


def _meshes(laid: SceneLayout, instances: Sequence[Instance]) -> list[Mesh]:
    """Return the meshes of a layout and of added instances, each once, in the order of their rows."""
    return list(dict.fromkeys([*laid.planes, *(instance.mesh for instance in _in_order(instances))]))


def _materials(laid: SceneLayout, instances: Sequence[Instance]) -> list[Material]:
    """Return the materials of a layout and of added instances, each once, in the order of the rows of Surfaces."""
    added = (material for instance in _in_order(instances) for material in instance.mesh.materials)
    return list(dict.fromkeys([*laid.materials, *added]))


def _with_instances(laid: SceneLayout, instances: Sequence[Instance]) -> _Rows:
    """Return the rows of a layout and of these instances. Raises UsageError for a corner that is not finite."""
    for name, mesh in {i.mesh: (i.name, i.mesh) for i in instances}.values():
        if not (np.isfinite(mesh.vertices).all() and np.isfinite(mesh.normals).all() and np.isfinite(mesh.uv).all()):
            raise UsageError(f"the mesh of '{name}' has a corner that is not finite: mend its vertices, normals or uv.")
    row_of = {material: row for row, material in enumerate(_materials(laid, instances))}
    instances = _in_order(instances)
    before = laid.arrays.triangles
    filled, first_chunk, static_count = len(before.position), len(before.chunk_first), laid.arrays.static_count
    triangles = _with_empty_rows(before, instances)
    planes, plane_count = dict(laid.planes), laid.plane_count
    movable: list[PlacedPart] = []
    lay_mesh = cache(_lay_mesh)  # meshes are compared by identity
    for instance in instances:
        mesh = instance.mesh
        rows = slice(filled, filled + len(mesh.triangles))
        filled = rows.stop
        chunk_rows = slice(first_chunk, first_chunk + len(_chunk_starts(mesh)))
        first_chunk = chunk_rows.stop
        of_mesh = lay_mesh(mesh)
        part = PlacedPart(instance, rows, chunk_rows, of_mesh)
        place(triangles, part, instance.position_ned, instance.turned)
        triangles.uv[rows], triangles.flat[rows] = of_mesh.uv, of_mesh.flat
        triangles.material[rows] = np.array([row_of[m] for m in mesh.materials], np.int32)[mesh.material]
        triangles.solid[rows], triangles.solid_radius[chunk_rows] = of_mesh.solid, of_mesh.solid_radius
        triangles.chunk_cut[chunk_rows] = is_cut_out(mesh)[_chunk_starts(mesh)]
        triangles.instance[rows] = instance.id
        if mesh not in planes:
            planes[mesh] = _flat_pieces(mesh, of_mesh.position, of_mesh.face)
        triangles.plane[rows] = planes[mesh] + plane_count
        plane_count += int(planes[mesh].max()) + 1
        if instance.movable:
            movable.append(part)
        else:
            static_count = filled
    return _Rows(triangles, list(planes.values()), plane_count, tuple(movable), static_count)


@dataclass(frozen=True, slots=True)
class LaidMesh:
    """The values of a mesh that all its instances share, in the asset's axes."""

    position: NDArray[np.float32]  # (T, 3, 3) m
    normal: NDArray[np.float32]  # (T, 3, 3)
    face: NDArray[np.float32]  # (T, 3)
    uv: NDArray[np.float32]  # (T, 3, 2)
    flat: NDArray[np.bool_]  # (T,)
    solid: NDArray[np.int8]  # (T,)
    solid_center: NDArray[np.float64]  # (C, 3) m, by chunk
    solid_radius: NDArray[np.float64]  # (C,) m


def _lay_mesh(mesh: Mesh) -> LaidMesh:
    normal, uv = mesh.normals[mesh.triangles], mesh.uv[mesh.triangles]
    solid, low, high = _closed_surfaces(mesh)
    starts = _chunk_starts(mesh)
    low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    return LaidMesh(
        solid=solid,
        solid_center=0.5 * (low + high),
        solid_radius=0.5 * np.linalg.norm(high - low, axis=1),
        position=mesh.vertices[mesh.triangles],
        normal=normal,
        face=face_normals(mesh),
        uv=uv - np.floor(uv.min(axis=1, keepdims=True)),  # textures repeat, and small numbers are more precise
        flat=(normal.max(axis=1) - normal.min(axis=1) < 1e-6).all(axis=1),
    )


def _chunk_starts(mesh: Mesh) -> NDArray[np.int64]:
    """Return the first triangle of each chunk of a mesh. No chunk has both opaque and cut-out triangles."""
    ends = [0, *(np.flatnonzero(np.diff(is_cut_out(mesh))) + 1).tolist(), len(mesh.triangles)]
    return np.concatenate([np.arange(first, end, CHUNK) for first, end in itertools.pairwise(ends)])


def _closed_surfaces(mesh: Mesh) -> tuple[NDArray[np.int8], NDArray[np.float64], NDArray[np.float64]]:
    """Return `Triangles.solid`, and the lower and upper bounds (T, 3), m, of each triangle's connected surface.

    A surface is closed if its triangles use every edge equally often in both directions. Its faces point outwards if
    its signed volume is positive. A surface with cut-out triangles is open.
    """
    place = _numbered(mesh.vertices)
    places = np.empty((int(place.max()) + 1, 3), np.float32)
    places[place] = mesh.vertices
    corners = place[mesh.triangles]
    begin, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low_end, high_end = np.minimum(begin, end).astype(np.int64), np.maximum(begin, end)
    surface_of = connected(low_end, high_end, len(places))
    edges, edge = np.unique(low_end * len(places) + high_end, return_inverse=True)
    forward = np.bincount(edge, np.where(begin < end, 1, -1))  # uses of each edge: one direction minus the other
    count = int(surface_of.max()) + 1
    is_open = np.zeros(count, np.bool_)
    is_open[surface_of[edges[forward != 0] // len(places)]] = True
    is_open[surface_of[corners[is_cut_out(mesh)]]] = True
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, surface_of, places)
    np.maximum.at(high, surface_of, places)
    surface = surface_of[corners[:, 0]]
    a, b, c = (places[corners[:, k]].astype(np.float64) for k in range(3))
    volume = np.bincount(surface, np.einsum("ij,ij->i", a, np.cross(b, c)), count)
    solid = np.where(is_open, 0, np.sign(volume)).astype(np.int8)
    return solid[surface], low[surface], high[surface]


def _with_empty_rows(before: Triangles, instances: Sequence[Instance]) -> Triangles:
    """Return `before` with empty rows added for these instances. A chunk never spans two instances."""
    starts: list[int] = []
    filled = len(before.position)
    for instance in instances:
        starts.extend((_chunk_starts(instance.mesh) + filled).tolist())
        filled += len(instance.mesh.triangles)
    first = np.concatenate([before.chunk_first, np.array(starts, np.int32)])
    rows, chunks = filled - len(before.position), len(starts)
    columns = {
        name: np.concatenate([old, np.zeros((chunks if name in BY_CHUNK else rows, *old.shape[1:]), old.dtype)])
        for name, old in before._asdict().items()
    }
    return Triangles(**columns)._replace(
        chunk_first=first, chunk_count=np.diff(np.append(first, filled)).astype(np.int32)
    )


def _flat_pieces(mesh: Mesh, position: NDArray[np.float32], face: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return a number per triangle: the same for triangles with the same material and plane.

    All foliage of one material is one piece, because the edges between leaves are too many to smooth.
    """
    offset = np.einsum("ij,ij->i", position[:, 0].astype(np.float64), face)
    key = np.column_stack((mesh.material, np.rint(face * 16.0), np.rint(offset * 8.0)))
    key[np.array([m.foliage for m in mesh.materials], np.bool_)[mesh.material], 1:] = 0.0
    return _numbered(key)


def _numbered(rows: NDArray[np.floating[Any]]) -> NDArray[np.int32]:
    """Return the inverse of numpy.unique(rows, axis=0), in a third of the time."""
    order = np.lexsort(rows.T[::-1])
    number = np.zeros(len(rows), np.int32)
    number[order[1:]] = np.cumsum((rows[order[1:]] != rows[order[:-1]]).any(axis=1))
    return number


def _surfaces(materials: Sequence[Material]) -> tuple[Surfaces, list[NDArray[np.uint8]]]:
    """Return the table of materials, and the pictures of their textures without duplicates."""
    pictures, rows = distinct([material.texture for material in materials])
    surfaces = Surfaces(
        color=np.array([m.color for m in materials], np.float32).reshape(-1, 3).clip(0.0),
        emission=np.array([m.emission for m in materials], np.float32),
        specular=np.array([m.specular for m in materials], np.float32),
        texture=rows,
        drift=np.array([m.drift for m in materials], np.float32),
        foliage=np.array([m.foliage for m in materials], np.bool_),
    )
    return surfaces, pictures


def _nothing() -> SceneLayout:
    vectors, numbers = np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
    triangles = Triangles(
        position=np.zeros((0, 3, 3), np.float32),
        normal=np.zeros((0, 3, 3), np.float32),
        uv=np.zeros((0, 3, 2), np.float32),
        face=vectors,
        flat=np.zeros(0, np.bool_),
        material=numbers,
        instance=numbers,
        plane=numbers,
        solid=np.zeros(0, np.int8),
        cutout=numbers,
        chunk_first=numbers,
        chunk_count=numbers,
        chunk_center=np.zeros((0, 3)),
        chunk_radius=np.zeros(0),
        chunk_cut=np.zeros(0, np.bool_),
        solid_center=np.zeros((0, 3)),
        solid_radius=np.zeros(0),
    )
    atlas: Atlas = build_atlas([])
    return SceneLayout(SceneArrays(triangles, _surfaces([])[0], atlas, cutouts_of([])[0], (), 0))


NOTHING = _nothing()
