"""Prepares the solids of a map for the physics: triangles in a grid, and the moving target as a box."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Array, Instance, Scene, kept_of_scene
from foundation.frames import vec3
from foundation.terrain import OPEN, MovingBox, Obstacles
from foundation.threads import once

CELL_M = 2.0
SOURCES = ("episodes/world/obstacles.py", "episodes/maps/scene.py", "foundation/*.py")  # cached values depend on these
BATCH = 4096  # triangles sorted at a time, to limit the memory that sorting takes
REACH_M = 0.7  # m, from a vehicle's origin to its farthest part, with room for the camera 0.5 m ahead


def obstacles(scene: Scene, reach_m: float = REACH_M) -> Obstacles:
    """Return all parts of a scene that a vehicle can hit, without the ground.

    Static solids keep their triangles. The first movable solid that a record adds to the map becomes an upright box;
    the map's own movable objects are left out. `reach_m`: from the vehicle's origin to its farthest part.
    """
    placed = scene.instances[len(scene.base.instances) :] if scene.base else scene.instances
    movable = [instance for instance in placed if instance.solid and instance.movable]
    box = bounding_box(movable[0]) if movable else None
    if scene.base and (of_map := _of_map(scene.base, reach_m)):
        added = _static_triangles(placed)
        together = with_more(of_map, *added) if added[2] else of_map
        if together:
            return replace(together, moving=box)
    return replace(_sorted(scene.instances, reach_m) or OPEN, moving=box)


@once(3)
def _of_map(scene: Scene, reach_m: float) -> Obstacles | None:
    name = f"obstacles-{reach_m:g}"
    return kept_of_scene(name, SOURCES, scene, lambda: _sorted(scene.instances, reach_m))


def _sorted(instances: Sequence[Instance], reach_m: float) -> Obstacles | None:
    triangles, owner, names = _static_triangles(instances)
    return sorted_into_cells(triangles, owner, names, reach_m) if names else None


def _static_triangles(instances: Sequence[Instance]) -> tuple[Array, NDArray[np.int32], tuple[str, ...]]:
    """Return (triangles, index of each triangle's name, names) of static solids, without ground and leaves."""
    static = [i for i in instances if i.solid and i.kind != "ground" and not i.movable]
    placed = [replace(instance, mesh=instance.mesh.without_foliage()).triangles_ned() for instance in static]
    owner = np.repeat(np.arange(len(static), dtype=np.int32), [len(t) for t in placed])
    return np.concatenate([np.zeros((0, 3, 3)), *placed]), owner, tuple(instance.name for instance in static)


def bounding_box(instance: Instance) -> MovingBox:
    """Return the box around an instance, in the instance's axes."""
    low, high = instance.mesh.vertices.min(axis=0), instance.mesh.vertices.max(axis=0)
    return MovingBox(instance.name, vec3((high - low) / 2), vec3((high + low) / 2))


def sorted_into_cells(triangles: Array, owner: NDArray[np.int32], names: tuple[str, ...], reach_m: float) -> Obstacles:
    """Return triangles (T, 3, 3), m NED, as Obstacles. Each cell lists the triangles within `reach_m` of the cell."""
    low, high = triangles.min(axis=(0, 1)) - reach_m, triangles.max(axis=(0, 1)) + reach_m
    origin = np.floor(low / CELL_M) * CELL_M
    cells = np.ceil((high - origin) / CELL_M).astype(np.int64)
    number, which = _in_cells(triangles, origin, cells, reach_m)
    start = np.zeros(cells.prod() + 1, np.int32)
    start[1:] = np.cumsum(np.bincount(number, minlength=cells.prod()))
    return Obstacles(
        corners=np.ascontiguousarray(triangles.reshape(-1, 9), dtype=np.float32),
        bounds=_bounds(triangles),
        owner=owner,
        names=names,
        origin_ned=vec3(origin),
        cell_m=CELL_M,
        cells=(int(cells[0]), int(cells[1]), int(cells[2])),
        start=start,
        index=which[np.argsort(number, kind="stable")],
        reach_m=reach_m,
    )


def with_more(
    before: Obstacles, triangles: Array, owner: NDArray[np.int32], names: tuple[str, ...]
) -> Obstacles | None:
    """Return `before` with more triangles: the same result as `sorted_into_cells` of all triangles, computed faster.

    Return None if the new triangles reach beyond the cells of `before`.
    """
    low, high = triangles.min(axis=(0, 1)) - before.reach_m, triangles.max(axis=(0, 1)) + before.reach_m
    origin, cells = np.array(before.origin_ned), np.array(before.cells, np.int64)
    if (low < origin).any() or (np.ceil((high - origin) / CELL_M) > cells).any():
        return None
    number, which = _in_cells(triangles, origin, cells, before.reach_m)
    order = np.argsort(number, kind="stable")
    number, which = number[order], which[order] + np.int32(len(before.corners))
    start = before.start.copy()
    start[1:] += np.cumsum(np.bincount(number, minlength=len(start) - 1)).astype(np.int32)
    return replace(
        before,
        corners=np.concatenate([before.corners, triangles.reshape(-1, 9).astype(np.float32)]),
        bounds=np.concatenate([before.bounds, _bounds(triangles)]),
        owner=np.concatenate([before.owner, owner + np.int32(len(before.names))]),
        names=before.names + names,
        start=start,
        index=np.insert(before.index, before.start[number + 1], which),
    )


def _bounds(triangles: Array) -> NDArray[np.float32]:
    """Return (T, 4), m: middle and radius of a ball around each triangle."""
    middle = (triangles.min(axis=1) + triangles.max(axis=1)) / 2
    radius = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1) * (1.0 + 1e-5) + 1e-5
    return np.column_stack([middle, radius]).astype(np.float32)


def _in_cells(
    triangles: Array, origin: Array, cells: NDArray[np.int64], reach_m: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the pairs (cell, triangle) of all triangles, computed batch by batch with `_cells_of`."""
    batches = range(0, len(triangles), BATCH)
    pairs = [_cells_of(triangles[k : k + BATCH], k, origin, cells, reach_m) for k in batches]
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def _cells_of(
    triangles: Array, number: int, origin: Array, cells: NDArray[np.int64], reach_m: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return a pair (cell, triangle) for each triangle of a batch and each cell within `reach_m` of the triangle.

    `number`: index of the batch's first triangle among all triangles.

    Cells far from a triangle's plane are left out. Otherwise a slanted roof would fill all cells of its bounding box.
    """
    low, high = triangles.min(axis=1) - reach_m, triangles.max(axis=1) + reach_m
    first = np.floor((low - origin) / CELL_M).astype(np.int32)
    span = np.minimum(np.floor((high - origin) / CELL_M).astype(np.int32), cells - 1) - first + 1
    count = span.prod(axis=1)
    which = np.repeat(np.arange(len(triangles)), count)
    step = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    _, columns, layers = span[which].T
    cell = first[which] + np.stack([step // (columns * layers), step // layers % columns, step % layers], axis=1)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    offset = np.einsum("ij,ij->i", normal, triangles[:, 0] - origin)
    away = np.einsum("ij,ij->i", normal[which], (cell + 0.5) * CELL_M) - offset[which]
    near = np.abs(away) <= reach_m + math.sqrt(0.75) * CELL_M
    flat = (cell[:, 0] * cells[1] + cell[:, 1]) * cells[2] + cell[:, 2]
    return flat[near].astype(np.int32), (which[near] + number).astype(np.int32)
