"""Builds the ground of the campus: one gently rolling surface, cut along the edges of plazas and walks.

Areas are convex polygons of (north, east) in metres, counter-clockwise with north as x and east as y. The cuts do not
change the surface, so the drawn ground and the height field agree to a few millimetres.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from episodes.maps import countryside
from episodes.maps import geometry as g
from episodes.maps.assets.materials import surface
from episodes.maps.scene import Array, Material, Mesh
from foundation.frames import course
from foundation.terrain import HeightField

REACH = 95.0  # m, half extent of the height field; beyond, the ground has the height of the edge
CELL = 0.5  # m, cell size of the height field
LATTICE = 2.5  # m, spacing of the nodes of the drawn surface; a multiple of CELL
FAR = (120.0, 170.0, 260.0, 430.0)  # m, grid lines of the drawn surface beyond REACH
RISE = 0.008  # m per m, slope of the ground, which rises to the north
MOUNDS = (  # north, east, height, spread in m; all in lawns
    (27.0, -13.0, 0.55, 5.0),
    (31.0, -40.0, 0.7, 5.0),
    (11.0, 31.5, 0.4, 3.0),
    (33.0, 17.0, 0.4, 4.5),
    (-25.0, 14.5, 0.6, 4.0),
    (-17.5, 37.5, 0.6, 3.5),
    (-24.5, -18.0, 0.5, 4.0),
    (-20.0, -37.0, 0.6, 5.0),
    (-70.0, -8.0, 0.5, 4.0),
    (-72.0, 10.0, 0.5, 5.0),
)


@dataclass(frozen=True, slots=True)
class Paving:
    """A piece of paved ground."""

    use: str  # 'plaza', 'walk', 'court', 'edging'
    ring: tuple[tuple[float, float], ...]  # (north, east) m, convex
    yaw: float = 0.0  # rad, direction in which its slabs are laid


def rect(use: str, north: tuple[float, float], east: tuple[float, float]) -> Paving:
    """Return the rectangular area between two north and two east coordinates (m)."""
    (n0, n1), (e0, e1) = north, east
    return Paving(use, ((n0, e0), (n1, e0), (n1, e1), (n0, e1)))


def ribbon(use: str, start: tuple[float, float], end: tuple[float, float], width: float) -> Paving:
    """Return the straight walk between two places, `width` (m) wide."""
    yaw = course(start, end)
    n, e = -math.sin(yaw) * width / 2, math.cos(yaw) * width / 2
    ring = (
        (start[0] - n, start[1] - e),
        (end[0] - n, end[1] - e),
        (end[0] + n, end[1] + e),
        (start[0] + n, start[1] + e),
    )
    return Paving(use, ring, yaw)


# in order of precedence: where two areas overlap, the first one is drawn
AREAS = (
    rect("plaza", (-17.5, 17.5), (-23.5, 23.5)),
    rect("edging", (-18.0, 18.0), (-24.0, 24.0)),
    rect("court", (33.4, 45.6), (-14.6, 14.6)),
    rect("edging", (33.0, 46.0), (-15.0, 15.0)),
    rect("court", (-11.6, 13.6), (-49.6, -37.4)),
    rect("edging", (-12.0, 14.0), (-50.0, -37.0)),
    rect("court", (-7.6, 23.6), (38.4, 51.6)),
    rect("edging", (-8.0, 24.0), (38.0, 52.0)),
    rect("court", (-47.6, -35.4), (-13.6, 21.6)),
    rect("edging", (-48.0, -35.0), (-14.0, 22.0)),
    rect("walk", (40.0, 44.0), (-48.0, 50.0)),
    rect("walk", (-46.0, -42.0), (-48.0, 50.0)),
    rect("walk", (-46.0, 44.0), (46.0, 50.0)),
    rect("walk", (-46.0, 44.0), (-48.0, -44.0)),
    rect("walk", (18.0, 47.0), (-2.5, 2.5)),
    rect("walk", (-84.0, -18.0), (-2.5, 2.5)),
    rect("walk", (-2.5, 2.5), (-51.0, -24.0)),
    rect("walk", (-2.5, 2.5), (24.0, 53.0)),
    ribbon("walk", (15.0, 21.0), (42.0, 48.0), 3.2),
    ribbon("walk", (15.0, -21.0), (42.0, -46.0), 3.2),
    ribbon("walk", (-15.0, 21.0), (-44.0, 48.0), 3.2),
    ribbon("walk", (-15.0, -21.0), (-44.0, -46.0), 3.2),
    rect("walk", (44.0, 49.5), (51.5, 56.5)),
    rect("walk", (44.0, 49.5), (-54.5, -49.5)),
    rect("walk", (-50.5, -46.0), (25.5, 30.5)),
    rect("walk", (-50.5, -46.0), (-34.5, -29.5)),
    rect("court", (35.8, 40.0), (27.0, 33.0)),
    rect("walk", (40.0, 44.0), (50.0, 60.0)),
    rect("walk", (40.0, 44.0), (-58.0, -48.0)),
)


def _looks() -> dict[str, tuple[Material, float]]:
    """Return use → (material, metres per repeat of its texture)."""
    return {
        "plaza": (surface("paving"), 3.0),
        "court": (surface("setts"), 2.0),
        "edging": (surface("concrete", (0.62, 0.60, 0.57)), 1.5),
        "walk": (surface("concrete", (0.95, 0.93, 0.88)), 1.5),
        "lawn": (surface("grass"), 4.0),
        "meadow": (surface("grass", (1.1, 1.04, 0.95)), 9.0),
    }


def _rolling(north: Array, east: Array) -> Array:
    """Return the NED z (m) of the smooth ground. The drawn surface joins points of this ground by flat triangles."""
    n, e = np.clip(north, -REACH, REACH), np.clip(east, -REACH, REACH)
    up = RISE * n
    for middle_n, middle_e, height, spread in MOUNDS:
        up = up + height * np.exp(-((n - middle_n) ** 2 + (e - middle_e) ** 2) / (2 * spread**2))
    return np.asarray(-up)


@cache
def _lattice() -> tuple[Array, Array]:
    """Return the grid lines (N,) in m, the same for north and east, and the NED z (N, N) of the nodes in m."""
    near = np.arange(-REACH, REACH + LATTICE / 2, LATTICE)
    lines = np.concatenate([-np.array(FAR[::-1]), near, np.array(FAR)])
    return lines, _rolling(lines[:, None], lines[None, :])


def surface_z(north: Array, east: Array) -> Array:
    """Return the NED z (m) of the drawn surface at points; `north` and `east` have the same shape."""
    lines, z = _lattice()
    i = np.clip(np.searchsorted(lines, north, side="right") - 1, 0, len(lines) - 2)
    j = np.clip(np.searchsorted(lines, east, side="right") - 1, 0, len(lines) - 2)
    u = (north - lines[i]) / (lines[i + 1] - lines[i])
    v = (east - lines[j]) / (lines[j + 1] - lines[j])
    a, b, c, d = z[i, j], z[i + 1, j], z[i + 1, j + 1], z[i, j + 1]
    return np.asarray(np.where(u >= v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d)))


def terrain() -> HeightField:
    """Return the height field of the surface."""
    line = np.arange(-REACH, REACH + CELL / 2, CELL)
    north, east = np.broadcast_arrays(line[:, None], line[None, :])
    return HeightField(-REACH, -REACH, CELL, surface_z(north, east))


def use_at(north: float, east: float) -> str:
    """Return the use of the first of AREAS that contains the point; 'lawn' if none does."""
    for area in AREAS:
        ring = zip(area.ring, (*area.ring[1:], area.ring[0]), strict=True)
        if all((n1 - n0) * (east - e0) - (e1 - e0) * (north - n0) >= 0.0 for (n0, e0), (n1, e1) in ring):
            return area.use
    return "lawn"


def ground() -> list[tuple[str, Mesh]]:
    """Return the ground as (use, mesh), one mesh for each use."""
    looks = _looks()
    rest = _triangles()
    pieces: dict[str, list[tuple[Array, float]]] = {}
    for area in AREAS:
        inside, rest = _cut(rest, area.ring)
        pieces.setdefault(area.use, []).append((inside, area.yaw))
    far = np.abs(rest).max(axis=(1, 2)) > REACH
    pieces["lawn"], pieces["meadow"] = [(rest[~far], 0.0)], [(rest[far], 0.0)]
    parts = {use: [_part(tri, yaw, *looks[use]) for tri, yaw in triangles] for use, triangles in pieces.items()}
    parts["meadow"].append(countryside.beyond(FAR[-1], _rolling, 1))
    return [(use, g.assemble(made)) for use, made in parts.items()]


def _triangles() -> Array:
    """Return the (T, 3, 2) triangles of the lattice in plan, counter-clockwise in (north, east)."""
    lines, _ = _lattice()
    n, e = np.broadcast_arrays(lines[:, None], lines[None, :])
    return g.lattice_triangles(np.stack([n, e], axis=2))


def _part(tri: Array, yaw: float, look: Material, tile: float) -> g.MeshPart:
    """Return triangles in plan as a part that lies on the surface, textured in plan along `yaw`."""
    up = -surface_z(tri[..., 0], tri[..., 1])
    # Corners of a part are FLU: forward is north, left is west. Changing the sign of east mirrors the triangles, so the
    # order of their corners is reversed.
    corners = np.stack([tri[..., 0], -tri[..., 1], up], axis=2)[:, ::-1]
    part = g.soup(corners, look, 25.0, tile)
    n, e, c, s = part.corners[..., 0], -part.corners[..., 1], math.cos(yaw), math.sin(yaw)
    return replace(part, uv=np.stack([c * n + s * e, c * e - s * n], axis=2) / tile)


def _cut(tri: Array, ring: tuple[tuple[float, float], ...]) -> tuple[Array, Array]:
    """Cut triangles (T, 3, 2) along a convex ring; return the pieces inside and the pieces outside."""
    corners = np.array(ring)
    beyond = (tri.max(axis=1) <= corners.min(axis=0)).any(axis=1) | (tri.min(axis=1) >= corners.max(axis=0)).any(axis=1)
    outside, inside = [tri[beyond]], tri[~beyond]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside, off = _split(inside, a, b)
        outside.append(off)
    return inside, np.concatenate(outside)


def _split(tri: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Split triangles by the line a → b; return the pieces on its left and the pieces on its right."""
    way = (b - a) / np.linalg.norm(b - a)
    side = way[0] * (tri[..., 1] - a[1]) - way[1] * (tri[..., 0] - a[0])
    side[np.abs(side) < 1e-9] = 0.0
    left, right = (side >= 0.0).all(axis=1), (side <= 0.0).all(axis=1)
    crossed = ~left & ~right
    kept, off = _crossed(tri[crossed], side[crossed])
    return np.concatenate([tri[left], kept]), np.concatenate([tri[right & ~left], off])


def _crossed(tri: Array, side: Array) -> tuple[Array, Array]:
    """Split triangles that all cross the line; return the pieces on its left and the pieces on its right.

    `side` (T, 3) is the distance (m) of each corner from the line, positive on its left.
    """
    positive = side > 0.0
    one_left = positive.sum(axis=1) == 1  # whether one corner is left of the line; otherwise, one is right of it
    lone = np.where(one_left, positive.argmax(axis=1), (side < 0.0).argmax(axis=1))
    row, order = np.arange(len(tri))[:, None], (lone[:, None] + np.arange(3)) % 3
    (a, b, c), (sa, sb, sc) = tri[row, order].transpose(1, 0, 2), side[row, order].T[..., None]
    p, q = a + (b - a) * (sa / (sa - sb)), a + (c - a) * (sa / (sa - sc))
    tip = np.stack([a, p, q], axis=1)
    rest = [np.stack([p, b, c], axis=1), np.stack([p, c, q], axis=1)]
    kept = np.concatenate([tip[one_left], *(piece[~one_left] for piece in rest)])
    off = np.concatenate([tip[~one_left], *(piece[one_left] for piece in rest)])
    return _solid(kept), _solid(off)


def _solid(tri: Array) -> Array:
    """Return the triangles that have an area. A cut through a corner makes triangles without area."""
    u, v = tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]
    return tri[np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) > 1e-12]
