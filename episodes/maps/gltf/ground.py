"""Finds the ground of a map by vertical rays, if the file does not describe the ground.

In each column of a grid, one ray goes down through all surfaces. Two surfaces that face up in neighbouring columns are
connected if a vehicle can step or drive from one to the other. The ground is everything connected to the surface under
the spawn. So a roof, a bridge or a tree above the street is not ground, even if it shares a mesh with the street.
"""

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from scipy import ndimage

from episodes.maps.geometry import connected
from episodes.maps.scene import Array
from foundation.terrain import HeightField

FINEST_M = 0.25  # cell size of a small map
MOST_CELLS = 512  # largest number of cells per side
REACH_M = 500.0  # from the spawn in each direction; farther out, the height at the edge applies
STEP_M = 0.25  # connected neighbours differ in height by at most this plus the cell size (a slope of 45°)
LAYERS = 24  # greatest number of surfaces that a ray passes
FACES_UP = 0.5  # least upward component of the unit normal of a ground surface: at most 60° from level
ROOM_M = 0.3  # least free height above a ground surface
HEADROOM_M = 2.0  # without a given height, the spawn is on the lowest floor with this free height
_RESTART_GAP_M = 1e-3  # m, from a hit to the start of the continued ray
_RAY_OFFSET_M = np.array([1.7e-4, 2.3e-4])  # m, offset of the rays from round coordinates, where maps have their edges


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The ground of a map."""

    field: HeightField
    triangles: NDArray[np.bool_]  # (T,) which of the given triangles are ground
    spawn_down: float  # m, NED, of the ground at the spawn


def find(triangles: Array, north: float, east: float, down: float | None) -> Ground | None:
    """Return the ground among triangles (T, 3, 3), m NED; None if there is none under the spawn.

    The winding of a triangle defines the side that it faces. If no triangle at the spawn faces up, both sides count.
    Of several floors, the one nearest to the NED z `down` (m) is used; if `down` is None, the lowest floor with
    HEADROOM_M, or else the lowest.
    """
    area = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    up = -area[:, 2] / np.maximum(np.linalg.norm(area, axis=1), 1e-12)
    columns = _Columns(triangles)
    start = columns.cut(np.array([[north, east]]))
    for facing in (up, np.abs(up)):
        chosen = _floor(start[0][:, 0], start[1][:, 0], facing, down)
        if chosen is not None:
            return _grow(triangles, columns, facing, (north, east), chosen)
    return None


class _Columns:
    """Casts rays straight down through triangles (T, 3, 3), m NED."""

    def __init__(self, triangles: Array) -> None:
        corners = triangles.reshape(-1, 3).astype(np.float32)
        self.low, self.high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
        self._top, self._length = self.low[2] - 1.0, self.high[2] - self.low[2] + 2.0
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))

    def cut(self, places: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return (NED z, triangle) of the surfaces at each place, (LAYERS, N), top first. The rest is nan and -1."""
        depth = np.full((LAYERS, len(places)), np.nan)
        which = np.full((LAYERS, len(places)), -1, np.int64)
        level = np.full(len(places), self._top)
        going = np.arange(len(places))
        way = np.array([0.0, 0.0, 1.0], np.float32)
        for layer in range(LAYERS):
            origin = np.column_stack([places[going], level[going]]).astype(np.float32)
            reach = np.full(len(going), self._length, np.float32)
            hit = self._scene.run(origin, np.tile(way, (len(going), 1)), reach, output=1)
            met = np.asarray(hit["primID"]) >= 0
            going = going[met]
            if not len(going):
                break
            depth[layer, going] = origin[met, 2].astype(np.float64) + np.asarray(hit["tfar"])[met]
            which[layer, going] = np.asarray(hit["primID"])[met]
            level[going] = depth[layer, going] + _RESTART_GAP_M
        return depth, which


def _floor(depth: Array, which: NDArray[np.int64], facing: Array, down: float | None) -> float | None:
    """Return the NED z of the ground in one column of surfaces, sorted from the top; None if no surface faces up."""
    there = np.flatnonzero(which >= 0)
    room = np.diff(depth[there], prepend=-np.inf)
    floors = [k for k in there if facing[which[k]] > FACES_UP]
    if not floors:
        return None
    if down is not None:
        return float(min((depth[k] for k in floors), key=lambda z: abs(z - down)))
    roomy = [k for k in floors if room[k] >= HEADROOM_M]
    return float(depth[(roomy or floors)[-1]])


def _grow(triangles: Array, columns: _Columns, facing: Array, spawn: tuple[float, float], spawn_down: float) -> Ground:
    """Return the ground that is connected to the surface at the spawn."""
    first = np.maximum(columns.low[:2], np.array(spawn) - REACH_M)
    last = np.minimum(columns.high[:2], np.array(spawn) + REACH_M)
    cell = max(FINEST_M, float((last - first).max()) / (MOST_CELLS - 1))
    shape = tuple(int(n) for n in np.floor((last - first) / cell + 1e-6).astype(int) + 1)
    lattice = np.stack(np.meshgrid(*(first[k] + cell * np.arange(shape[k]) for k in (0, 1)), indexing="ij"), axis=-1)
    inside = np.minimum(lattice.reshape(-1, 2) + _RAY_OFFSET_M, last - _RAY_OFFSET_M)
    depth, which = columns.cut(inside)
    layers = int((which >= 0).any(axis=1).sum())
    if layers == 0:
        flat = HeightField(float(first[0]), float(first[1]), cell, np.full(shape, spawn_down))
        return Ground(flat, np.zeros(len(triangles), np.bool_), spawn_down)
    depth, which = depth[:layers], which[:layers]
    # A surface with less room than ROOM_M above it is under a slab and is not ground. Without this rule, the result for
    # a slab that touches the ground would depend on the processor, whose rounding decides which of the two a ray hits.
    room = np.diff(depth, axis=0, prepend=-np.inf)
    depth = np.where((which >= 0) & (facing[which] > FACES_UP) & (room >= ROOM_M), depth, np.nan)
    label = _joined(depth.reshape(layers, *shape), STEP_M + cell).reshape(layers, -1)
    row, column = (min(max(round((spawn[k] - first[k]) / cell), 0), shape[k] - 1) for k in (0, 1))
    here = row * shape[1] + column
    gap = np.abs(depth[:, here] - spawn_down)
    if np.isnan(gap).all():  # the rules exclude all surfaces at the spawn: take the map's surface nearest in height
        gap = np.abs(depth - spawn_down).ravel()
        chosen = label.ravel()[np.nanargmin(gap)]
    else:
        chosen = label[np.nanargmin(gap), here]
    is_ground = (label == chosen) & ~np.isnan(depth)
    lowest = np.argmax(np.where(is_ground, depth, -np.inf), axis=0)
    every = np.arange(depth.shape[1])
    has_ground = is_ground[lowest, every]
    down = np.where(has_ground, depth[lowest, every], np.nan).reshape(shape)
    flagged = np.zeros(len(triangles), np.bool_)
    flagged[which[lowest, every][has_ground]] = True
    nearest = ndimage.distance_transform_edt(np.isnan(down), return_distances=False, return_indices=True)
    field = HeightField(float(first[0]), float(first[1]), cell, np.ascontiguousarray(down[tuple(nearest)]))
    return Ground(field, flagged | _on_field(triangles, facing, field), spawn_down)


def _joined(depth: NDArray[np.float64], step: float) -> NDArray[np.int64]:
    """Return a component number for each surface (L, N, M). Neighbours within `step` (m) in height are joined."""
    layers = depth.shape[0]
    number = np.arange(depth.size).reshape(depth.shape)
    ends: list[NDArray[np.int64]] = []
    for axis in (1, 2):
        size = depth.shape[axis] - 1
        for a in range(layers):
            near_a = np.take(depth[a], range(size), axis - 1)
            if np.isnan(near_a).all():
                continue
            for b in range(layers):
                near_b = np.take(depth[b], range(1, size + 1), axis - 1)
                close = np.abs(near_a - near_b) <= step  # false for nan
                pair = (
                    np.take(number[a], range(size), axis - 1)[close],
                    np.take(number[b], range(1, size + 1), axis - 1)[close],
                )
                ends.append(np.stack(pair))
    edges = np.concatenate(ends, axis=1) if ends else np.zeros((2, 0), np.int64)
    return connected(edges[0], edges[1], depth.size).reshape(depth.shape)


def _on_field(triangles: Array, facing: Array, field: HeightField) -> NDArray[np.bool_]:
    """Return which triangles face up and lie on the height field. These include small triangles that no ray hit."""
    points = np.concatenate([triangles, triangles.mean(axis=1, keepdims=True)], axis=1)
    i = (points[..., 0] - field.origin_north) / field.cell_m
    j = (points[..., 1] - field.origin_east) / field.cell_m
    level = ndimage.map_coordinates(field.down, [i.ravel(), j.ravel()], order=1, mode="nearest").reshape(i.shape)
    near = (np.abs(points[..., 2] - level) < 0.06 + 0.1 * field.cell_m).all(axis=1)
    return np.asarray((facing > FACES_UP) & near)
