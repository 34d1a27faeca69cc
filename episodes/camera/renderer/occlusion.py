"""Computes the open share of the sky at a point: the share that nearby things do not hide.

Each cell of a coarse horizontal grid has a column, from the lowest to the highest surface of the map's static things in
that cell. The open share of the sky is computed from the columns once, at LAYERS heights above the ground. Movable
instances, and instances that a scene adds to its map, darken the cells around their footprints for one picture.
"""

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import SceneArrays
from foundation.compiled import njit
from foundation.terrain import HeightField

CELLS = 512  # cells per side of the grid
LEAST_CELL_M = 0.4
MARGIN_CELLS = 4
LAYERS = 4
LAYER_1_M, LAYER_2_M, LAYER_3_M = 1.5, 4.0, 9.0  # m above the ground; layer 0 is at the ground
LAYER_HEIGHTS = np.array((0.05, LAYER_1_M, LAYER_2_M, LAYER_3_M))
EMPTY = 1e30  # lower end of the column of an empty cell; the upper end is -EMPTY

AZIMUTHS = 12
RINGS = (1.0, 2.0, 3.0, 5.0, 8.0, 13.0, 20.0, 30.0)  # distances, in cells, at which columns may hide the sky
BINS = 16  # ranges of elevation angle; level ground gets the same light from each range of the sky
DARKEST = 0.16  # lower limit of the open share, because walls reflect light

SUB_CELLS = 6  # a footprint is drawn on a finer grid, with this many cells per cell and direction
REACH_M = 0.45  # standard deviation of the blur of a footprint
CLEARANCE_M = 0.5  # for a thing this high above the ground, the shadow has about a third of its full darkness
FOOT_M = 0.9  # the footprint contains a thing's points up to this height above the thing's lowest point
FOOT_SHARE = 0.30  # factor on the open share below a thing that stands on the ground
ON_TOP_M = 0.6  # a point on top is at most this far below its column's upper end; roofs slope within a cell
FACES_UP = 0.35  # the normal at a point on top has at least this upward component
ROOF_M = 1.0  # a point on top is at least this high above the ground


class Columns(NamedTuple):
    """The column on each cell of the grid. Index i counts north from `low_north`, j counts east from `low_east`."""

    low: NDArray[np.float32]  # (N, N) m above the origin's level, EMPTY for an empty cell
    high: NDArray[np.float32]  # (N, N) m
    color: NDArray[np.float32]  # (N, N, 3) linear reflectance
    low_north: float  # m, north coordinate of the middle of cell (0, 0)
    low_east: float  # m, east coordinate of the middle of cell (0, 0)
    per_cell: float  # cells per m


class Occlusion(NamedTuple):
    """The open share of the sky on the cells of a grid."""

    open: NDArray[np.uint64]  # (N, N) 16 bits per layer; values are 0 … 255, so that weighted sums fit
    ground: NDArray[np.float32]  # (N, N) m above the origin's level
    top: NDArray[np.float32]  # (N, N) m, upper end of the column; for an empty cell, of the highest column next to it
    low_north: float  # m, as in Columns
    low_east: float  # m
    per_cell: float  # cells per m


def columns_of(layout: SceneArrays, stop: int, ground_ids: frozenset[int], means: NDArray[np.float32]) -> Columns:
    """Return the columns of triangles 0 … stop - 1, except the ground. `means` (M, 3): mean colours of materials."""
    triangles = layout.triangles
    stands = ~np.isin(triangles.instance[:stop], sorted(ground_ids))
    corners = triangles.position[:stop][stands][..., :2].reshape(-1, 2)
    low, high = (corners.min(axis=0), corners.max(axis=0)) if len(corners) else (np.zeros(2), np.zeros(2))
    cell = max(float((high - low).max()) / (CELLS - 1 - 2 * MARGIN_CELLS), LEAST_CELL_M)
    north, east = (0.5 * (float(a) + float(b)) - 0.5 * (CELLS - 1) * cell for a, b in zip(low, high, strict=True))
    columns = Columns(
        low=np.full((CELLS, CELLS), EMPTY, np.float32),
        high=np.full((CELLS, CELLS), -EMPTY, np.float32),
        color=np.zeros((CELLS, CELLS, 3), np.float32),
        low_north=north,
        low_east=east,
        per_cell=1.0 / cell,
    )
    _fill(columns, triangles.position, triangles.material, means, stands)
    return columns


@njit(cache=True, nogil=True)
def _fill(
    columns: Columns,
    position: NDArray[np.float32],
    material: NDArray[np.int32],
    means: NDArray[np.float32],
    stands: NDArray[np.bool_],
) -> None:
    """Extend the columns to points, less than a cell apart, on the triangles that `stands` marks."""
    cells, per = columns.low.shape[0], columns.per_cell
    for t in range(len(stands)):
        if not stands[t]:
            continue
        p = position[t]
        x0, y0 = (p[0, 0] - columns.low_north) * per + 0.5, (p[0, 1] - columns.low_east) * per + 0.5
        x1, y1 = (p[1, 0] - p[0, 0]) * per, (p[1, 1] - p[0, 1]) * per
        x2, y2 = (p[2, 0] - p[0, 0]) * per, (p[2, 1] - p[0, 1]) * per
        longest = max(abs(x1), abs(y1), abs(x2), abs(y2), abs(x2 - x1), abs(y2 - y1))
        parts = min(int(1.5 * longest) + 1, 4 * cells)
        tone = means[material[t]]
        for a in range(parts + 1):
            wa = a / parts
            for b in range(parts + 1 - a):
                wb = b / parts
                i, j = int(x0 + wa * x1 + wb * x2), int(y0 + wa * y1 + wb * y2)
                if 0 <= i < cells and 0 <= j < cells:
                    up = -(p[0, 2] + wa * (p[1, 2] - p[0, 2]) + wb * (p[2, 2] - p[0, 2]))
                    if columns.high[i, j] <= -EMPTY:
                        for c in range(3):
                            columns.color[i, j, c] = tone[c]
                    else:
                        for c in range(3):
                            columns.color[i, j, c] += 0.1 * (tone[c] - columns.color[i, j, c])
                    columns.low[i, j] = min(columns.low[i, j], up)
                    columns.high[i, j] = max(columns.high[i, j], up)


def occlusion_of(columns: Columns, terrain: HeightField) -> Occlusion:
    """Return the open share of the sky on each cell, above the ground of `terrain`."""
    cells, cell = columns.low.shape[0], 1.0 / columns.per_cell
    rows, across = terrain.down.shape
    north = np.rint((columns.low_north + cell * np.arange(cells) - terrain.origin_north) / terrain.cell_m)
    east = np.rint((columns.low_east + cell * np.arange(cells) - terrain.origin_east) / terrain.cell_m)
    i, j = np.clip(north, 0, rows - 1).astype(int), np.clip(east, 0, across - 1).astype(int)
    ground = (-terrain.down[i][:, j]).astype(np.float32)
    reach = 2 * int(RINGS[-1]) + 1
    near = cv2.dilate((columns.high > -EMPTY).astype(np.uint8), np.ones((reach, reach), np.uint8)).astype(np.bool_)
    turn = 2.0 * math.pi * (np.arange(AZIMUTHS) + 0.37)[:, None] / AZIMUTHS
    steps = np.rint(np.stack((np.cos(turn) * RINGS, np.sin(turn) * RINGS), axis=2)).astype(np.int64)
    open_share = np.ones((cells, cells, LAYERS), np.float32)
    _trace(columns, ground, near, steps, LAYER_HEIGHTS, open_share)
    lanes = np.empty((cells, cells, LAYERS), np.uint16)
    for k in range(LAYERS):
        layer = np.ascontiguousarray(open_share[..., k])
        outside = (layer >= 0.0).astype(np.float32)
        total, count = cv2.blur(layer * outside, (5, 5)), cv2.blur(outside, (5, 5))
        # cells within walls get the mean of the cells outside, so that the blur does not darken cells beside walls
        layer = np.where(outside > 0.0, layer, np.where(count > 0.01, total / np.maximum(count, 0.01), 1.0))
        layer = cv2.GaussianBlur(layer.astype(np.float32), (3, 3), 0.7)
        lanes[..., k] = np.rint(255.0 * (DARKEST + (1.0 - DARKEST) * layer))
    packed = lanes.reshape(cells, -1).view(np.uint64)
    top = np.where(columns.high > -EMPTY, columns.high, cv2.dilate(columns.high, np.ones((3, 3), np.uint8)))
    return Occlusion(packed, ground, top, columns.low_north, columns.low_east, columns.per_cell)


@njit(cache=True, nogil=True, allocates=True)
def _trace(
    columns: Columns,
    ground: NDArray[np.float32],
    near: NDArray[np.bool_],
    steps: NDArray[np.int64],
    heights: NDArray[np.float64],
    open_share: NDArray[np.float32],
) -> None:
    """Fill `open_share` (N, N, LAYERS) where `near` is True: 0 … 1, or -1 at heights within the cell's own column.

    `near` (N, N): whether a column is near the cell. `steps` (A, R, 2): the offsets, in cells, to the cells that may
    block the sky, by azimuth and distance.
    """
    cells, cell = columns.low.shape[0], 1.0 / columns.per_cell
    counts = np.zeros(LAYERS, np.int64)
    masks = np.zeros(LAYERS, np.int64)
    own = np.zeros(LAYERS, np.int64)
    for i in range(cells):
        for j in range(cells):
            if not near[i, j]:
                continue
            low, high = columns.low[i, j], columns.high[i, j]
            for k in range(LAYERS):
                z = ground[i, j] + heights[k]
                counts[k] = 0
                own[k] = _blocked(low - z, EMPTY, 0.5 * cell) if low < EMPTY and low > z else 0
            for a in range(steps.shape[0]):
                for k in range(LAYERS):
                    masks[k] = own[k]
                for s in range(steps.shape[1]):
                    p, q = i + steps[a, s, 0], j + steps[a, s, 1]
                    if p < 0 or q < 0 or p >= cells or q >= cells:
                        break
                    low, high = columns.low[p, q], columns.high[p, q]
                    if low < EMPTY:
                        away = cell * math.sqrt(steps[a, s, 0] ** 2 + steps[a, s, 1] ** 2)
                        for k in range(LAYERS):
                            z = ground[i, j] + heights[k]
                            masks[k] |= _blocked(low - z, high - z, away)
                for k in range(LAYERS):
                    mask = masks[k]
                    while mask:
                        mask &= mask - 1
                        counts[k] += 1
            low, high = columns.low[i, j], columns.high[i, j]
            for k in range(LAYERS):
                z = ground[i, j] + heights[k]
                if low - 0.3 <= z and z < high:
                    open_share[i, j, k] = -1.0
                else:
                    open_share[i, j, k] = 1.0 - counts[k] / (BINS * steps.shape[0])


@njit(cache=True, nogil=True, inline="always")
def _blocked(low: float, high: float, away: float) -> int:
    """Return the bins of elevation, one bit each, that a column from `low` to `high` hides at a distance `away` (m)."""
    if high <= 0.0:
        return 0
    square = away * away
    top = int(BINS * (high * high / (high * high + square)) + 0.5)
    bottom = int(BINS * (low * low / (low * low + square)) + 0.5) if low > 0.0 else 0
    return ((1 << top) - 1) & ~((1 << bottom) - 1)


@njit(cache=True, nogil=True, inline="always")
def open_sky(shade: Occlusion, n: float, e: float, d: float, facing_down: float) -> tuple[float, float]:
    """Return the open share (0 … 1) of the sky at a point (NED, m), and the point's height (m) above the ground.

    `facing_down` is the downward component of the surface's normal. On a roof, layers below the roof do not count.
    Outside the grid, the share is 1 and the height is EMPTY.
    """
    x = (n - shade.low_north) * shade.per_cell
    y = (e - shade.low_east) * shade.per_cell
    last = shade.open.shape[0] - 1.0
    if not (0.0 <= x < last and 0.0 <= y < last):
        return 1.0, EMPTY
    i, j = int(x), int(y)
    wx, wy = int(16.0 * (x - i)), int(16.0 * (y - j))
    w11 = wx * wy
    w10, w01 = 16 * wx - w11, 16 * wy - w11
    lanes = shade.open[i, j] * np.uint64(256 - w11 - w10 - w01) + shade.open[i, j + 1] * np.uint64(w01)
    lanes += shade.open[i + 1, j] * np.uint64(w10) + shade.open[i + 1, j + 1] * np.uint64(w11)
    up = level = -d - shade.ground[i, j]
    lies_on_top = False
    if facing_down < -FACES_UP and up > ROOF_M:
        top = shade.top[i + (wx >> 3), j + (wy >> 3)]
        if -d > top - ON_TOP_M:
            lies_on_top, level = True, max(top, -d) - shade.ground[i, j]
            if level > LAYER_3_M:
                return 1.0, up
    if level < LAYER_1_M:
        first, between = 0, max(level, 0.0) * (1.0 / LAYER_1_M)
    elif level < LAYER_2_M:
        first, between = 16, (level - LAYER_1_M) * (1.0 / (LAYER_2_M - LAYER_1_M))
    else:
        first, between = 32, min((level - LAYER_2_M) * (1.0 / (LAYER_3_M - LAYER_2_M)), 1.0)
    if lies_on_top:  # the lower layer is within or under the thing, so only the upper layer counts
        between = 1.0
    a = float((lanes >> np.uint64(first)) & np.uint64(0xFFFF))
    b = float((lanes >> np.uint64(first + 16)) & np.uint64(0xFFFF))
    return (a + (b - a) * between) * (1.0 / (255.0 * 256.0)), up


class ShadowFootprint(NamedTuple):
    """The outline of the lowest part of a thing, seen from above."""

    outline: NDArray[np.float64]  # (K, 2) m, convex
    bottom: float  # m, NED z of the thing's lowest point


def footprint(corners: NDArray[np.float32]) -> ShadowFootprint:
    """Return the footprint of triangles (T, 3, 3), m, NED."""
    points = corners.reshape(-1, 3)
    bottom = float(points[:, 2].max())
    feet = points[points[:, 2] > bottom - FOOT_M][:, :2]
    return ShadowFootprint(cv2.convexHull(np.ascontiguousarray(feet, np.float32))[:, 0].astype(np.float64), bottom)


class ContactShadows:
    """Darkens the cells around movable instances, and around instances that a scene adds to its map.

    Scenes of one map share the grid. One at a time draws into it.
    """

    def __init__(self, shade: Occlusion, turn: threading.Lock, added: Sequence[ShadowFootprint] = ()) -> None:
        """`turn` is the lock for drawing into `shade`. `added` are static things that are not in `shade`."""
        self._shade, self._turn, self._added = shade, turn, tuple(added)

    @contextmanager
    def cast(self, things: Sequence[ShadowFootprint]) -> Iterator[Occlusion]:
        """Yield the grid, darkened around the added and these footprints (NED); restore it after the block."""
        lanes = self._shade.open.view(np.uint16).reshape(*self._shade.open.shape, LAYERS)
        with self._turn:
            covered = []
            try:
                for thing in (*self._added, *things):
                    drawn = _footprint_factor(self._shade, thing)
                    if drawn is not None:
                        where, factor = drawn
                        part = lanes[where]
                        covered.append((where, part.copy()))
                        part[..., 0] = np.rint(part[..., 0] * factor)
                        part[..., 1] = np.rint(part[..., 1] * (0.35 + 0.65 * factor))
                yield self._shade
            finally:
                for where, kept in reversed(covered):
                    lanes[where] = kept


def _footprint_factor(
    shade: Occlusion, thing: ShadowFootprint
) -> tuple[tuple[slice, slice], NDArray[np.float32]] | None:
    """Return the cells around a footprint, and the factor on their open share.

    None for a footprint that is outside the grid, more than 64 cells wide, or too high above the ground.
    """
    places = (thing.outline - (shade.low_north, shade.low_east)) * shade.per_cell
    reach = 2.0 * REACH_M * shade.per_cell + 1.0
    low = np.maximum(np.floor(places.min(axis=0) - reach), 0).astype(int)
    high = np.minimum(np.ceil(places.max(axis=0) + reach) + 1, shade.open.shape[0]).astype(int)
    if (high <= low).any() or (high - low).max() > 64:
        return None
    middle = np.clip(np.rint(places.mean(axis=0)), low, high - 1).astype(int)
    clearance = max(-thing.bottom - float(shade.ground[middle[0], middle[1]]), 0.0)
    strength = (1.0 - FOOT_SHARE) * math.exp(-clearance / CLEARANCE_M)
    if strength < 0.02:
        return None
    fine = np.zeros(((high[0] - low[0]) * SUB_CELLS, (high[1] - low[1]) * SUB_CELLS), np.float32)
    sub = ((places - low + 0.5) * SUB_CELLS - 0.5)[:, ::-1]
    cv2.fillConvexPoly(fine, np.rint(16.0 * sub).astype(np.int32), 1.0, cv2.LINE_8, 4)
    fine = cv2.GaussianBlur(fine, (0, 0), REACH_M * shade.per_cell * SUB_CELLS)
    size = (int(high[1] - low[1]), int(high[0] - low[0]))
    cover = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
    return (slice(low[0], high[0]), slice(low[1], high[1])), 1.0 - strength * np.minimum(1.15 * cover, 1.0)
