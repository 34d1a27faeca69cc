"""Draws the shadow map: the height of the surface nearest to the sun, for each ray of a fine grid of parallel rays.

The shadow map of static instances is drawn once, and all scenes of a map share it. Movable instances, and those that a
scene adds to its map, are drawn into this shadow map for one picture, and then removed.
"""

import itertools
import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import PlacedPart, SceneArrays, Triangles
from episodes.maps.cutouts import OPAQUE, Cutouts, is_opaque_texel
from episodes.maps.scene import Sun
from foundation.compiled import njit
from foundation.frames import Vec3

CELLS = 4096  # cells per side of the shadow map
MARGIN_CELLS = 4
SLOPE_LIMIT = 12.0  # upper limit of a receiving plane's slope: m along the rays per m across
BIAS_M = 0.015


class SunMap(NamedTuple):
    """A shadow map: heights towards the sun, on a grid perpendicular to the sun's rays.

    Cell (j, i) belongs to the ray at `(low_across, low_up) + (i, j)·cell`, along `across` and `up`.
    """

    height: NDArray[np.float32]  # (CELLS, CELLS) m along `toward`; -1e30 where the ray meets nothing
    across: tuple[float, float, float]  # unit, NED
    up: tuple[float, float, float]  # unit, NED
    toward: tuple[float, float, float]  # unit, NED
    low_across: float  # m
    low_up: float  # m
    cell: float  # m
    per_cell: float  # 1/m


def sun_map(layout: SceneArrays, sun: Sun, ground_ids: frozenset[int], cells: int = CELLS) -> SunMap:
    """Return the shadow map of static instances. Its grid covers all things on the ground, and their shadows."""
    result = _grid(layout, sun, ground_ids, cells, np.full((cells, cells), -1e30, np.float32))
    draw_heights(result, layout.triangles, layout.cutouts, 0, layout.static_count)
    return result


def fits(layout: SceneArrays, sun: Sun, ground_ids: frozenset[int], before: SunMap) -> bool:
    """Return whether `before`, a shadow map of some triangles of `layout`, has the grid that `sun_map` would make."""
    return _grid(layout, sun, ground_ids, before.height.shape[0], before.height)[1:] == before[1:]


def _grid(layout: SceneArrays, sun: Sun, ground_ids: frozenset[int], cells: int, height: NDArray[np.float32]) -> SunMap:
    toward = np.asarray(sun.toward_ned, float) / np.linalg.norm(sun.toward_ned)
    helper = np.array([1.0, 0.0, 0.0]) if abs(toward[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    across = np.cross(helper, toward)
    across /= np.linalg.norm(across)
    up = np.cross(toward, across)
    triangles = layout.triangles
    # a thing and its shadow are on the same rays, so a grid that covers the things also covers their shadows
    casts = ~np.isin(triangles.instance, sorted(ground_ids))
    low, high = np.zeros(2), np.zeros(2)
    if len(casts):
        _bounds(triangles.position, casts if casts.any() else ~casts, across, up, low, high)
    cell = max(float((high - low).max()) / (cells - 1 - 2 * MARGIN_CELLS), 0.005)
    low = 0.5 * (low + high) - 0.5 * (cells - 1) * cell
    return SunMap(
        height=height,
        across=(float(across[0]), float(across[1]), float(across[2])),
        up=(float(up[0]), float(up[1]), float(up[2])),
        toward=(float(toward[0]), float(toward[1]), float(toward[2])),
        low_across=float(low[0]),
        low_up=float(low[1]),
        cell=cell,
        per_cell=1.0 / cell,
    )


@njit(cache=True, nogil=True, allocates=True)
def _bounds(
    position: NDArray[np.float32],
    casts: NDArray[np.bool_],
    across: NDArray[np.float64],
    up: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> None:
    """Fill `low` and `high` (2,), m along `across` and `up`, with the bounds of the triangles in `casts` (T,)."""
    low[:], high[:] = np.inf, -np.inf
    for t in range(len(casts)):
        if casts[t]:
            for k in range(3):
                n, e, d = float(position[t, k, 0]), float(position[t, k, 1]), float(position[t, k, 2])
                x = n * across[0] + e * across[1] + d * across[2]
                y = n * up[0] + e * up[1] + d * up[2]
                low[0], high[0] = min(low[0], x), max(high[0], x)
                low[1], high[1] = min(low[1], y), max(high[1], y)


class Shadows:
    """The shadows of one scene. All scenes of a map share one shadow map (64 MB) and take turns."""

    def __init__(self, sun: SunMap, turn: threading.Lock, added: Sequence[slice] = ()) -> None:
        """`turn` is the lock for drawing into `sun`. `added` are triangles of static instances that `sun` lacks."""
        self._sun, self._turn, self._added = sun, turn, added

    @contextmanager
    def cast(self, layout: SceneArrays, movable: Iterable[PlacedPart]) -> Iterator[SunMap]:
        """Yield the shadow map with these movable instances drawn in; they are removed after the block."""
        with self._turn:
            covered = draw_instances(self._sun, layout, [*self._added, *(part.triangles for part in movable)])
            try:
                yield self._sun
            finally:
                for where, heights in reversed(covered):  # in reverse order because instances may overlap
                    self._sun.height[where] = heights


def instance_slices(triangles: Triangles, first: int, stop: int) -> list[slice]:
    """Return the triangles first … stop - 1 as one slice per instance."""
    of = triangles.instance[first:stop]
    ends = [first, *(first + 1 + np.flatnonzero(np.diff(of))).tolist(), stop]
    return [slice(a, b) for a, b in itertools.pairwise(ends) if b > a]


def draw_instances(
    sun: SunMap, layout: SceneArrays, instances: Iterable[slice]
) -> list[tuple[tuple[slice, slice], NDArray[np.float32]]]:
    """Draw instances, one slice of triangles each, into the map; return the overwritten places and heights."""
    axes = np.column_stack((sun.across, sun.up))
    cells = sun.height.shape[0]
    covered = []
    for rows in instances:
        flat = layout.triangles.position[rows].reshape(-1, 3) @ axes - (sun.low_across, sun.low_up)
        low = np.clip(np.floor(flat.min(axis=0) / sun.cell), 0, cells).astype(int)
        high = np.clip(np.ceil(flat.max(axis=0) / sun.cell) + 1, 0, cells).astype(int)
        where = (slice(low[1], high[1]), slice(low[0], high[0]))
        covered.append((where, sun.height[where].copy()))
        draw_heights(sun, layout.triangles, layout.cutouts, rows.start, rows.stop)
    return covered


@njit(cache=True, nogil=True, allocates=True)
def draw_heights(sun: SunMap, triangles: Triangles, cutouts: Cutouts, first: int, stop: int) -> None:
    """Raise `sun.height` to the triangles first … stop - 1, except at the holes of their textures."""
    position = triangles.position
    cells = sun.height.shape[0]
    last = cells - 1.0
    x = np.empty(3)
    y = np.empty(3)
    z = np.empty(3)
    for t in range(first, stop):
        for k in range(3):
            n, e, d = float(position[t, k, 0]), float(position[t, k, 1]), float(position[t, k, 2])
            x[k] = (sun.across[0] * n + sun.across[1] * e + sun.across[2] * d - sun.low_across) / sun.cell
            y[k] = (sun.up[0] * n + sun.up[1] * e + sun.up[2] * d - sun.low_up) / sun.cell
            z[k] = sun.toward[0] * n + sun.toward[1] * e + sun.toward[2] * d
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if area == 0.0:
            continue
        za = ((z[1] - z[0]) * (y[2] - y[0]) - (z[2] - z[0]) * (y[1] - y[0])) / area
        zb = ((z[2] - z[0]) * (x[1] - x[0]) - (z[1] - z[0]) * (x[2] - x[0])) / area
        top = math.ceil(max(min(y[0], y[1], y[2]), 0.0))
        bottom = math.floor(min(max(y[0], y[1], y[2]), last))
        highest = np.float32(max(z[0], z[1], z[2]))
        which, uv = triangles.cutout[t], triangles.uv[t]
        for j in range(top, bottom + 1):
            low, high = 1e30, -1e30
            for k in range(3):  # where the row crosses the outline
                m = k + 1 if k < 2 else 0
                ya, yb = y[k], y[m]
                if (ya <= j <= yb or yb <= j <= ya) and ya != yb:
                    s = x[k] + (x[m] - x[k]) * ((j - ya) / (yb - ya))
                    low, high = min(low, s), max(high, s)
                elif ya == j and yb == j:
                    low, high = min(low, x[k], x[m]), max(high, x[k], x[m])
            low, high = max(low, 0.0), min(high, last)
            if low > high:
                continue
            for i in range(math.ceil(low), math.floor(high) + 1):
                h = min(np.float32(z[0] + za * (i - x[0]) + zb * (j - y[0])), highest)
                if h > sun.height[j, i]:
                    if which != OPAQUE:
                        b = ((i - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (j - y[0])) / area
                        c = ((x[1] - x[0]) * (j - y[0]) - (i - x[0]) * (y[1] - y[0])) / area
                        a = 1.0 - b - c
                        u = a * uv[0, 0] + b * uv[1, 0] + c * uv[2, 0]
                        if not is_opaque_texel(cutouts, which, u, a * uv[0, 1] + b * uv[1, 1] + c * uv[2, 1]):
                            continue
                    sun.height[j, i] = h


@njit(cache=True, nogil=True)
def sun_slopes(sun: SunMap, nn: float, ne: float, nd: float) -> Vec3:
    """Return (slope_x, slope_y, bias), m, of a plane with unit normal n (NED).

    The slopes are the changes of the plane's height per cell. A point counts as lit if it is at most `bias` below the
    height in the map.
    """
    lit = sun.toward[0] * nn + sun.toward[1] * ne + sun.toward[2] * nd
    k = -sun.cell / max(lit, 1e-6)
    limit = SLOPE_LIMIT * sun.cell
    slope_x = min(max(k * (sun.across[0] * nn + sun.across[1] * ne + sun.across[2] * nd), -limit), limit)
    slope_y = min(max(k * (sun.up[0] * nn + sun.up[1] * ne + sun.up[2] * nd), -limit), limit)
    # the bias grows with the slope: on a curved surface, points within the filter may be higher than the plane
    return slope_x, slope_y, BIAS_M + 0.2 * (abs(slope_x) + abs(slope_y)) + 0.1 * sun.cell


@njit(cache=True, nogil=True, inline="always")
def sunlight(sun: SunMap, n: float, e: float, d: float, slope_x: float, slope_y: float, bias: float) -> float:
    """Return the share (0 … 1) of the sun's disc that reaches the point (n, e, d), NED, m, of a plane.

    The share is 1 outside the map. Inside, it is the mean of 2 × 2 bilinear comparisons. Each cell is compared with the
    height of the receiving plane at that cell. So a slanted plane does not shade itself, and a small bias is enough,
    also below thin things.
    """
    x = (sun.across[0] * n + sun.across[1] * e + sun.across[2] * d - sun.low_across) * sun.per_cell - 0.5
    y = (sun.up[0] * n + sun.up[1] * e + sun.up[2] * d - sun.low_up) * sun.per_cell - 0.5
    share = 1.0
    if 0.0 <= x < sun.height.shape[1] - 3.0 and 0.0 <= y < sun.height.shape[0] - 3.0:
        i = int(x)
        j = int(y)
        fx = x - i
        fy = y - j
        z = sun.toward[0] * n + sun.toward[1] * e + sun.toward[2] * d + bias
        z -= (fx + 0.5) * slope_x + (fy + 0.5) * slope_y
        share = 0.0
        for dj in range(3):
            row = sun.height[j + dj, i : i + 3]
            part = (1.0 - fx) if row[0] <= z else 0.0
            part += 1.0 if row[1] <= z + slope_x else 0.0
            part += fx if row[2] <= z + 2.0 * slope_x else 0.0
            share += part * (1.0 - fy if dj == 0 else (1.0 if dj == 1 else fy))
            z += slope_y
        share *= 0.25
    return share
