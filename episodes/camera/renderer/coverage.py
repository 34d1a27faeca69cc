"""Rasterizes a scene: finds the triangle that each sample of the picture sees.

Triangles are drawn in homogeneous coordinates. Source: Olano and Greer, "Triangle scan conversion using 2D homogeneous
coordinates", 1997. The three edge functions of a triangle are linear in the picture, even if corners are behind the
camera. The near plane is a fourth linear function, so it splits no triangle. Neighbouring triangles have exactly the
same coefficients for their common edge, with opposite signs, so there are no gaps.

The sample grid has `grain` (an even number) samples per pixel in each direction. Sample (j, i), in row j and column i,
is at (i / grain, j / grain) px. The sample in the middle of a pixel decides the pixel's depth and id. The other samples
are for smooth edges; some are on the borders between pixels.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from episodes.camera.renderer.layout import NEAR_M, Eye, Triangles
from episodes.maps.cutouts import Cutouts, is_opaque_texel
from foundation.compiled import njit
from foundation.frames import Vec3

BAND = 16  # rows of samples that one thread fills at a time
NOTHING = -1  # instead of a triangle's number: the sample sees the sky


class Drawn(NamedTuple):
    """The values that `set_up` computes for each triangle of a scene in one picture."""

    # (T, 9) a, b, c of three edge functions a·i + b·j + c at sample (j, i). The functions are ≥ 0 inside the triangle.
    # Each is proportional to the weight of one corner in the interpolation at that sample
    edges: NDArray[np.float64]
    volume: NDArray[np.float64]  # (T,) m³: planar depth = volume / (sum of the three edge functions)
    nearest: NDArray[np.float64]  # (T,) 1/m, greatest inverse depth of a corner; < 0: the near plane cuts the triangle
    rows: NDArray[np.int32]  # (T, 2) first and last row of samples; first > last: not in the picture
    columns: NDArray[np.int32]  # (T, 2) first and last column of samples; undefined if nearest < 0
    chunk_seen: NDArray[np.bool_]  # (C,) whether the chunk (triangles culled together) may be in the picture


def new_drawn(triangles: int, chunks: int) -> Drawn:
    return Drawn(
        edges=np.zeros((triangles, 9)),
        volume=np.zeros(triangles),
        nearest=np.zeros(triangles),
        rows=np.zeros((triangles, 2), np.int32),
        columns=np.zeros((triangles, 2), np.int32),
        chunk_seen=np.zeros(chunks, np.bool_),
    )


@njit(cache=True, nogil=True)
def set_up(thread: int, threads: int, triangles: Triangles, eye: Eye, drawn: Drawn) -> None:
    """Fill `drawn` for the chunks of one thread: cull them against the view, then set up their triangles."""
    slope_x = eye.center_x / eye.focal
    slope_y = eye.center_y / eye.focal
    per_x = math.sqrt(1.0 + slope_x * slope_x)
    per_y = math.sqrt(1.0 + slope_y * slope_y)
    for chunk in range(thread, triangles.chunk_first.size, threads):
        r = triangles.chunk_radius[chunk]
        x, y, z = _in_camera(triangles.chunk_center[chunk], eye)
        seen = x + r >= NEAR_M and abs(y) - slope_x * x <= r * per_x and abs(z) - slope_y * x <= r * per_y
        drawn.chunk_seen[chunk] = seen
        if seen:
            # back faces of a solid are visible only from inside, or where the near plane cuts the front away
            dx = triangles.solid_center[chunk, 0] - eye.position[0]
            dy = triangles.solid_center[chunk, 1] - eye.position[1]
            dz = triangles.solid_center[chunk, 2] - eye.position[2]
            apart = triangles.solid_radius[chunk] + 2.0 * NEAR_M * per_x * per_y
            is_outside = dx * dx + dy * dy + dz * dz > apart * apart
            first = triangles.chunk_first[chunk]
            for t in range(first, first + triangles.chunk_count[chunk]):
                solid = triangles.solid[t] if is_outside else 0
                _set_up_triangle(t, solid, triangles.position, eye, drawn)


@njit(cache=True, nogil=True, inline="always")
def _in_camera(place: NDArray[np.floating[Any]], eye: Eye) -> Vec3:
    """Return a place (m, NED) in camera axes: forward, right, down, m from the optical centre."""
    dx = float(place[0]) - eye.position[0]
    dy = float(place[1]) - eye.position[1]
    dz = float(place[2]) - eye.position[2]
    return (
        eye.forward[0] * dx + eye.forward[1] * dy + eye.forward[2] * dz,
        eye.right[0] * dx + eye.right[1] * dy + eye.right[2] * dz,
        eye.down[0] * dx + eye.down[1] * dy + eye.down[2] * dz,
    )


@njit(cache=True, nogil=True)
def _set_up_triangle(t: int, solid: int, position: NDArray[np.float32], eye: Eye, drawn: Drawn) -> None:
    drawn.rows[t, 0] = 1
    drawn.rows[t, 1] = 0
    x0, y0, z0 = _in_camera(position[t, 0], eye)
    x1, y1, z1 = _in_camera(position[t, 1], eye)
    x2, y2, z2 = _in_camera(position[t, 2], eye)
    if max(x0, x1, x2) < NEAR_M:
        return
    k = eye.center_x / eye.focal
    if (y0 > k * x0 and y1 > k * x1 and y2 > k * x2) or (-y0 > k * x0 and -y1 > k * x1 and -y2 > k * x2):
        return
    ax, ay, az = y1 * z2 - z1 * y2, z1 * x2 - x1 * z2, x1 * y2 - y1 * x2
    bx, by, bz = y2 * z0 - z2 * y0, z2 * x0 - x2 * z0, x2 * y0 - y2 * x0
    cx, cy, cz = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    volume = x0 * ax + y0 * ay + z0 * az
    if volume == 0.0 or solid * volume > 0.0:
        return  # the camera sees the triangle exactly edge-on, or the back of a closed surface
    grain = float(eye.grain)
    rows = 2.0 * grain * eye.center_y  # the last row of samples is grain · H
    nearest = -1.0
    if min(x0, x1, x2) >= NEAR_M:
        v0, v1, v2 = z0 / x0, z1 / x1, z2 / x2
        low, high = min(v0, v1, v2), max(v0, v1, v2)
        h0, h1, h2 = y0 / x0, y1 / x1, y2 / x2
        scale = grain * eye.focal
        left = math.ceil(scale * min(h0, h1, h2) + grain * eye.center_x - 1e-6)
        last = math.floor(scale * max(h0, h1, h2) + grain * eye.center_x + 1e-6)
        if left > last:
            return  # the triangle is between two columns of samples
        drawn.columns[t, 0] = int(max(left, 0.0))
        drawn.columns[t, 1] = int(min(last, 2.0 * grain * eye.center_x))
        nearest = 1.0 / min(x0, x1, x2)
    else:
        low, high = 1e30, -1e30
        low, high = _widen(x0, z0, x1, z1, low, high)
        low, high = _widen(x1, z1, x2, z2, low, high)
        low, high = _widen(x2, z2, x0, z0, low, high)
    top = math.ceil(max(grain * (eye.focal * low + eye.center_y) - 1e-6, 0.0))
    bottom = math.floor(min(grain * (eye.focal * high + eye.center_y) + 1e-6, rows))
    if top > bottom:
        return

    side = 1.0 if volume > 0.0 else -1.0
    step = side / (grain * eye.focal)
    sx = side * eye.center_x / eye.focal
    sy = side * eye.center_y / eye.focal
    e = drawn.edges[t]
    e[0], e[1], e[2] = ay * step, az * step, side * ax - ay * sx - az * sy
    e[3], e[4], e[5] = by * step, bz * step, side * bx - by * sx - bz * sy
    e[6], e[7], e[8] = cy * step, cz * step, side * cx - cy * sx - cz * sy
    drawn.volume[t] = abs(volume)
    drawn.nearest[t] = nearest
    drawn.rows[t, 0] = int(top)
    drawn.rows[t, 1] = int(bottom)


@njit(cache=True, nogil=True)
def _widen(xa: float, za: float, xb: float, zb: float, low: float, high: float) -> tuple[float, float]:
    """Return the range (low, high) of slopes z / x, extended by the part of edge a to b beyond the near plane."""
    if xa >= NEAR_M:
        low, high = min(low, za / xa), max(high, za / xa)
    if (xa >= NEAR_M) != (xb >= NEAR_M):
        s = (za + (zb - za) * (NEAR_M - xa) / (xb - xa)) / NEAR_M
        low, high = min(low, s), max(high, s)
    return low, high


@njit(cache=True, nogil=True, allocates=True)
def sort_into_bands(
    triangles: Triangles, drawn: Drawn, bands: int, chunks: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return (start, items): band k holds triangles items[start[k]:start[k + 1]], in the order of `chunks`."""
    start = np.zeros(bands + 1, np.int64)
    for chunk in chunks:
        if drawn.chunk_seen[chunk]:
            first = triangles.chunk_first[chunk]
            for t in range(first, first + triangles.chunk_count[chunk]):
                if drawn.rows[t, 0] <= drawn.rows[t, 1]:
                    last = min(drawn.rows[t, 1] // BAND, bands - 1)
                    for band in range(min(drawn.rows[t, 0] // BAND, bands - 1), last + 1):
                        start[band + 1] += 1
    for band in range(bands):
        start[band + 1] += start[band]
    items = np.empty(start[bands], np.int32)
    fill = start[:bands].copy()
    for chunk in chunks:
        if drawn.chunk_seen[chunk]:
            first = triangles.chunk_first[chunk]
            for t in range(first, first + triangles.chunk_count[chunk]):
                if drawn.rows[t, 0] <= drawn.rows[t, 1]:
                    last = min(drawn.rows[t, 1] // BAND, bands - 1)
                    for band in range(min(drawn.rows[t, 0] // BAND, bands - 1), last + 1):
                        items[fill[band]] = t
                        fill[band] += 1
    return start, items


@njit(cache=True, nogil=True)
def draw_bands(
    thread: int,
    threads: int,
    drawn: Drawn,
    start: NDArray[np.int64],
    items: NDArray[np.int32],
    cut_start: NDArray[np.int64],
    cut_items: NDArray[np.int32],
    uv: NDArray[np.float32],
    cutout: NDArray[np.int32],
    cutouts: Cutouts,
    samples: NDArray[np.int32],
    inverse_depths: NDArray[np.float32],
    lowest: NDArray[np.float32],
    count_up: NDArray[np.float32],
) -> None:
    """Write the nearest triangle (or NOTHING) of every sample in this thread's bands.

    `samples` has the shape (grain · H + 1, grain · W + 1). `sort_into_bands` returns (`start`, `items`) for opaque
    triangles and (`cut_start`, `cut_items`) for those with holes in their textures. Opaque triangles are drawn first,
    because they hide most of the others. At equal depth, the triangle that is drawn first wins. `cutout`
    and `uv` are the fields of `Triangles`. `inverse_depths` (threads, 2 BAND, grain · W + 1) and `lowest` (threads,
    grain · W + 1) are work arrays for each thread. `count_up` (grain · W + 1,) is 0, 1, 2 …
    """
    bands = start.size - 1
    height = samples.shape[0]
    inverse_depth = inverse_depths[thread]
    for band in range(thread, bands, threads):
        top = band * BAND
        bottom = height - 1 if band == bands - 1 else top + BAND - 1
        inverse_depth[: bottom - top + 1] = 0.0
        samples[top : bottom + 1] = NOTHING
        for k in range(start[band], start[band + 1]):
            _draw(items[k], drawn, top, bottom, inverse_depth, samples, count_up)
        if cut_start[band] < cut_start[band + 1]:
            _find_lowest(inverse_depth[: bottom - top + 1], lowest[thread])
        for k in range(cut_start[band], cut_start[band + 1]):
            t = cut_items[k]
            if _is_hidden(drawn.nearest[t], drawn.columns[t, 0], drawn.columns[t, 1], lowest[thread]):
                continue
            _draw_cut_out(t, drawn, top, bottom, inverse_depth, samples, count_up, uv[t], cutout[t], cutouts)


@njit(cache=True, nogil=True)
def _find_lowest(inverse_depth: NDArray[np.float32], lowest: NDArray[np.float32]) -> None:
    """Fill `lowest` (n,) with the least inverse depth of each column of `inverse_depth` (k, n)."""
    lowest[:] = np.inf
    for j in range(len(inverse_depth)):
        row = inverse_depth[j]
        for i in range(len(lowest)):
            lowest[i] = row[i] if row[i] < lowest[i] else lowest[i]


@njit(cache=True, nogil=True)
def _is_hidden(nearest: float, first: int, last: int, lowest: NDArray[np.float32]) -> bool:
    """Return whether a triangle is behind all samples of its columns first … last; False if the near plane cuts it.

    `lowest` (n,) is the least inverse depth of each column.
    """
    hidden, limit, i = nearest > 0.0, np.float32(nearest), first
    while hidden and i <= last:
        hidden = limit <= lowest[i]
        i += 1
    return hidden


class _Slopes(NamedTuple):
    """Values that all rows of a triangle share. The inverse depth at sample (j, i) is wa·i + wb·j + wc."""

    wa: float
    wb: float
    wc: float
    ia: float  # −1 / a of the first edge; 0 if a is 0
    ib: float  # −1 / a of the second edge; 0 if a is 0
    ic: float  # −1 / a of the third edge; 0 if a is 0
    iw: float  # 1 / wa, 0 if wa is 0; only used for a triangle that the near plane cuts
    is_cut: bool
    limit: np.float32  # greatest inverse depth: rounding must not bring a thin triangle nearer than its corners


@njit(cache=True, nogil=True, inline="always")
def _slopes(e: NDArray[np.float64], volume: float, nearest: float) -> _Slopes:
    per = 1.0 / volume
    wa = (e[0] + e[3] + e[6]) * per
    return _Slopes(
        wa,
        (e[1] + e[4] + e[7]) * per,
        (e[2] + e[5] + e[8]) * per,
        -1.0 / e[0] if e[0] != 0.0 else 0.0,
        -1.0 / e[3] if e[3] != 0.0 else 0.0,
        -1.0 / e[6] if e[6] != 0.0 else 0.0,
        1.0 / wa if wa != 0.0 else 0.0,
        nearest < 0.0,
        np.float32(nearest if nearest > 0.0 else 1.0 / NEAR_M),
    )


@njit(cache=True, nogil=True, inline="always")
def _span(e: NDArray[np.float64], slopes: _Slopes, j: int, right: float) -> tuple[int, int]:
    """Return the first sample of row `j` inside a triangle, and the number of samples inside; ≤ 0: none."""
    low, high = _cut(e[0], slopes.ia, e[1] * j + e[2], 0.0, right)
    low, high = _cut(e[3], slopes.ib, e[4] * j + e[5], low, high)
    low, high = _cut(e[6], slopes.ic, e[7] * j + e[8], low, high)
    if slopes.is_cut:  # the fourth edge: inverse depth ≤ 1 / near
        low, high = _cut(-slopes.wa, slopes.iw, 1.0 / NEAR_M - slopes.wb * j - slopes.wc, low, high)
    if low > high:
        return 0, 0
    begin = math.ceil(low)
    return begin, math.floor(high) - begin + 1


@njit(cache=True, nogil=True)
def _draw(
    t: int,
    drawn: Drawn,
    top: int,
    bottom: int,
    inverse_depth: NDArray[np.float32],
    samples: NDArray[np.int32],
    count_up: NDArray[np.float32],
) -> None:
    """Draw an opaque triangle into the rows `top` … `bottom` of samples. `inverse_depth` begins at row `top`."""
    name, e = np.int32(t), drawn.edges[t]
    slopes = _slopes(e, drawn.volume[t], drawn.nearest[t])
    limit = slopes.limit
    for j in range(max(drawn.rows[t, 0], top), min(drawn.rows[t, 1], bottom) + 1):
        begin, count = _span(e, slopes, j, samples.shape[1] - 1.0)
        if count <= 0:
            continue
        depth_row = inverse_depth[j - top, begin : begin + count]
        sample_row = samples[j, begin : begin + count]
        w0 = np.float32(slopes.wa * begin + slopes.wb * j + slopes.wc)
        step = np.float32(slopes.wa)
        for i in range(count):
            w = w0 + step * count_up[i]
            w = w if w < limit else limit
            closer = w > depth_row[i]
            depth_row[i] = w if closer else depth_row[i]
            sample_row[i] = name if closer else sample_row[i]


@njit(cache=True, nogil=True)
def _draw_cut_out(
    t: int,
    drawn: Drawn,
    top: int,
    bottom: int,
    inverse_depth: NDArray[np.float32],
    samples: NDArray[np.int32],
    count_up: NDArray[np.float32],
    uv: NDArray[np.float32],
    which: int,
    cutouts: Cutouts,
) -> None:
    """Draw a triangle like `_draw`, but omit the samples that see a hole in the triangle's texture."""
    name, e, per = np.int32(t), drawn.edges[t], 1.0 / drawn.volume[t]
    slopes = _slopes(e, drawn.volume[t], drawn.nearest[t])
    limit = slopes.limit
    # u / depth and v / depth are linear in the picture, like the inverse depth
    u0, u1, u2 = uv[0, 0] * per, uv[1, 0] * per, uv[2, 0] * per
    v0, v1, v2 = uv[0, 1] * per, uv[1, 1] * per, uv[2, 1] * per
    ua, ub, uc = e[0] * u0 + e[3] * u1 + e[6] * u2, e[1] * u0 + e[4] * u1 + e[7] * u2, e[2] * u0 + e[5] * u1 + e[8] * u2
    va, vb, vc = e[0] * v0 + e[3] * v1 + e[6] * v2, e[1] * v0 + e[4] * v1 + e[7] * v2, e[2] * v0 + e[5] * v1 + e[8] * v2
    for j in range(max(drawn.rows[t, 0], top), min(drawn.rows[t, 1], bottom) + 1):
        begin, count = _span(e, slopes, j, samples.shape[1] - 1.0)
        if count <= 0:
            continue
        depth_row = inverse_depth[j - top, begin : begin + count]
        sample_row = samples[j, begin : begin + count]
        wide = slopes.wa * begin + slopes.wb * j + slopes.wc
        w0 = np.float32(wide)
        step = np.float32(slopes.wa)
        u_here, v_here = ua * begin + ub * j + uc, va * begin + vb * j + vc
        for i in range(count):
            w = w0 + step * count_up[i]
            w = w if w < limit else limit
            if w > depth_row[i]:
                depth = 1.0 / max(wide + slopes.wa * i, 1e-12)
                if is_opaque_texel(cutouts, which, (u_here + ua * i) * depth, (v_here + va * i) * depth):
                    depth_row[i] = w
                    sample_row[i] = name


@njit(cache=True, nogil=True)
def _cut(a: float, inverse: float, rest: float, low: float, high: float) -> tuple[float, float]:
    """Return the part of [low, high] in which a·i + rest ≥ 0; `inverse` is -1 / a."""
    if a > 0.0:
        low = max(low, rest * inverse)
    elif a < 0.0:
        high = min(high, rest * inverse)
    elif rest < 0.0:
        high = -1.0
    return low, high
