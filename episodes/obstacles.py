"""The solid things of a map as the physics wants them: triangles in a grid, and the moving target as a box."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from episodes.scene import Instance, Scene
from episodes.visibility import turn
from foundation.frames import Vec3
from foundation.obstacles import OPEN, MovingBox, Obstacles

CELL_M = 2.0
BATCH = 4096  # triangles sorted at a time: bounds the memory that sorting takes
REACH_M = 0.7  # m, from a vehicle's origin to the farthest part of it: the camera sits half a metre ahead

Array = NDArray[np.float64]


def obstacles(scene: Scene, reach_m: float = REACH_M) -> Obstacles:
    """Return what a vehicle that reaches `reach_m` from its origin can hit in a scene, its ground excepted.

    What stands is taken triangle by triangle; the first solid that may move becomes an upright box.
    """
    standing = [one for one in scene.instances if one.solid and one.kind != "ground" and not one.movable]
    moving = [one for one in scene.instances if one.solid and one.movable]
    box = bounding_box(moving[0]) if moving else None
    if not standing:
        return replace(OPEN, moving=box)
    placed = [_triangles(one) for one in standing]
    owner = np.repeat(np.arange(len(standing), dtype=np.int32), [len(t) for t in placed])
    names = tuple(one.name for one in standing)
    return sorted_into_cells(np.concatenate(placed), owner, names, reach_m, moving=box)


def bounding_box(one: Instance) -> MovingBox:
    """Return the box around an instance, in its own axes."""
    low, high = one.mesh.vertices.min(axis=0), one.mesh.vertices.max(axis=0)
    return MovingBox(one.name, _vector((high - low) / 2), _vector((high + low) / 2))


def sorted_into_cells(
    triangles: Array,
    owner: NDArray[np.int32],
    names: tuple[str, ...],
    reach_m: float,
    *,
    cell_m: float = CELL_M,
    moving: MovingBox | None = None,
) -> Obstacles:
    """Return triangles (T, 3, 3) in metres NED as Obstacles. Each goes into every cell it comes within reach of."""
    low, high = triangles.min(axis=1) - reach_m, triangles.max(axis=1) + reach_m
    origin = np.floor(low.min(axis=0) / cell_m) * cell_m
    cells = np.ceil((high.max(axis=0) - origin) / cell_m).astype(np.int64)
    pairs = [
        _cells_of(triangles[k : k + BATCH], k, low[k : k + BATCH], high[k : k + BATCH], origin, cells, cell_m, reach_m)
        for k in range(0, len(triangles), BATCH)
    ]
    number, which = np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])
    start = np.zeros(cells.prod() + 1, np.int32)
    start[1:] = np.cumsum(np.bincount(number, minlength=cells.prod()))
    middle = (triangles.min(axis=1) + triangles.max(axis=1)) / 2
    radius = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1) * (1.0 + 1e-5) + 1e-5
    return Obstacles(
        corners=np.ascontiguousarray(triangles.reshape(-1, 9), dtype=np.float32),
        bounds=np.column_stack([middle, radius]).astype(np.float32),
        owner=owner,
        names=names,
        origin_ned=_vector(origin),
        cell_m=cell_m,
        cells=(int(cells[0]), int(cells[1]), int(cells[2])),
        start=start,
        index=which[np.argsort(number, kind="stable")],
        reach_m=reach_m,
        moving=moving,
    )


def _cells_of(
    triangles: Array,
    number: int,
    low: Array,
    high: Array,
    origin: Array,
    cells: NDArray[np.int64],
    cell_m: float,
    reach_m: float,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return (cell, triangle) for every cell that a batch of triangles, counted from `number`, comes within reach of.

    Cells off a triangle's plane are left out: a slanted roof would otherwise fill all those of its bounding box.
    """
    first = np.floor((low - origin) / cell_m).astype(np.int32)
    span = np.minimum(np.floor((high - origin) / cell_m).astype(np.int32), cells - 1) - first + 1
    count = span.prod(axis=1)
    which = np.repeat(np.arange(len(triangles)), count)
    step = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    _, columns, layers = span[which].T
    cell = first[which] + np.stack([step // (columns * layers), step // layers % columns, step % layers], axis=1)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    offset = np.einsum("ij,ij->i", normal, triangles[:, 0] - origin)
    away = np.einsum("ij,ij->i", normal[which], (cell + 0.5) * cell_m) - offset[which]
    near = np.abs(away) <= reach_m + math.sqrt(0.75) * cell_m
    flat = (cell[:, 0] * cells[1] + cell[:, 1]) * cells[2] + cell[:, 2]
    return flat[near].astype(np.int32), (which[near] + number).astype(np.int32)


def _triangles(one: Instance) -> Array:
    placed: Array = one.mesh.vertices.astype(np.float64) @ turn(one.yaw).T + np.array(one.position_ned)
    return placed[one.mesh.triangles]


def _vector(values: Array) -> Vec3:
    return (float(values[0]), float(values[1]), float(values[2]))
