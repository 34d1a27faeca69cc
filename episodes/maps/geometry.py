"""Builds the solid primitives that make up every asset.

Shapes have forward-left-up axes (FLU, metres, z = 0 on the ground), so that heights are positive. `assemble` rotates
them by half a turn about the forward axis into the FRD axes of `episodes.maps.scene.Mesh`. A rotation keeps outward
faces outward.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from episodes.maps.scene import Array, Material, Mesh
from foundation.frames import Vec3

PlanCorner = Array | tuple[float, float]
PlanBox = tuple[
    float, float, float, PlanCorner, PlanCorner
]  # footprint: north, east (m), yaw (rad), low, high corner (2,)

PlanRect = tuple[tuple[float, float], tuple[float, float]]  # lower and upper corner, m in x and y

CREASE_DEG = 38.0  # faces that meet at a smaller angle are shaded as one smooth surface

# triangles of the unit cube, and for each one the matrix from a corner to its texture coordinates (see `slope_uv`)
_CUBE = np.array(
    [
        [(1, 0, 0), (1, 1, 0), (1, 1, 1)], [(1, 0, 0), (1, 1, 1), (1, 0, 1)],
        [(0, 1, 0), (0, 0, 0), (0, 0, 1)], [(0, 1, 0), (0, 0, 1), (0, 1, 1)],
        [(1, 1, 0), (0, 1, 0), (0, 1, 1)], [(1, 1, 0), (0, 1, 1), (1, 1, 1)],
        [(0, 0, 0), (1, 0, 0), (1, 0, 1)], [(0, 0, 0), (1, 0, 1), (0, 0, 1)],
        [(0, 0, 1), (1, 0, 1), (1, 1, 1)], [(0, 0, 1), (1, 1, 1), (0, 1, 1)],
        [(0, 1, 0), (1, 1, 0), (1, 0, 0)], [(0, 1, 0), (1, 0, 0), (0, 0, 0)],
    ],
    dtype=np.float64,
)  # fmt: skip
_CUBE_UV = np.repeat(
    np.array(
        [
            [(0, 1, 0), (0, 0, -1)], [(0, -1, 0), (0, 0, -1)], [(-1, 0, 0), (0, 0, -1)],
            [(1, 0, 0), (0, 0, -1)], [(1, 0, 0), (0, -1, 0)], [(1, 0, 0), (0, 1, 0)],
        ],
        dtype=np.float64,
    ),
    2,
    axis=0,
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """Unconnected triangles of one material."""

    corners: Array  # (T, 3, 3) m, FLU, counter-clockwise seen from outside
    normals: Array  # (T, 3, 3) unit, FLU
    uv: Array  # (T, 3, 2), 1 = one repeat of the texture
    material: Material


def connected(a: NDArray[np.integer], b: NDArray[np.integer], count: int) -> NDArray[np.int64]:
    """Return for each point of a graph the number of its connected part, (count,).

    Edge k of the graph connects the points a[k] and b[k]. Parts are numbered from 0 in the order of their first points.
    """
    from scipy.sparse import coo_array  # slow to import; undrawn flights on a kept map do not call this
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], np.int64)


def gap_m(north: float, east: float, box: PlanBox) -> float:
    """Return the distance (m) in plan from a point to a footprint; 0 inside."""
    n, e, yaw, low, high = box
    c, s = math.cos(yaw), math.sin(yaw)
    x, y = c * (north - n) + s * (east - e), -s * (north - n) + c * (east - e)
    return math.hypot(max(low[0] - x, 0.0, x - high[0]), max(low[1] - y, 0.0, y - high[1]))


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of two arrays (N, 3), faster than the more general `numpy.cross`."""
    out = np.empty(np.broadcast(a, b).shape)
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def face_normals(corners: Array) -> Array:
    """Return the normals (T, 3) of triangles (T, 3, 3). A normal's length is twice the triangle's area."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return cross(a, b)


def creased_normals(corners: Array, crease_deg: float = CREASE_DEG) -> Array:
    """Return (T, 3, 3) unit corner normals: area-weighted means over faces that meet at less than `crease_deg`."""
    area = face_normals(corners)
    unit = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-12)
    if crease_deg <= 0.0:
        return np.repeat(unit[:, None, :], 3, axis=1)
    keys = np.round(corners.reshape(-1, 3) * 1e4).astype(np.int64)
    packed = (keys[:, 0] * 2_000_003 + keys[:, 1]) * 2_000_003 + keys[:, 2]
    _, place, count = np.unique(packed, return_inverse=True, return_counts=True)
    order = np.argsort(place, kind="stable")
    first = np.concatenate(([0], np.cumsum(count)[:-1]))
    # every ordered pair of corners that share a position
    fan = count[place]
    corner = np.repeat(np.arange(len(place)), fan)
    step = np.arange(len(corner)) - np.repeat(np.cumsum(fan) - fan, fan)
    neighbour = order[first[place[corner]] + step]
    near = np.einsum("ij,ij->i", unit[corner // 3], unit[neighbour // 3]) > np.cos(np.radians(crease_deg))
    total = np.stack(
        [np.bincount(corner[near], weights=area[neighbour[near] // 3, k], minlength=len(place)) for k in range(3)],
        axis=1,
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    smooth = np.where(length > 1e-12, total / np.maximum(length, 1e-12), np.repeat(unit, 3, axis=0))
    return smooth.reshape(-1, 3, 3)


def slope_uv(corners: Array, tile_m: float) -> Array:
    """Return (T, 3, 2) texture coordinates: u horizontal along each face, v down its slope, one repeat per `tile_m`."""
    area = face_normals(corners)
    unit = area / np.maximum(np.linalg.norm(area, axis=1, keepdims=True), 1e-12)
    along = np.stack([-unit[:, 1], unit[:, 0], np.zeros(len(unit))], axis=1)
    level = np.linalg.norm(along, axis=1) < 0.05
    along[level] = (1.0, 0.0, 0.0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = cross(unit, along)
    return np.stack([np.einsum("tck,tk->tc", corners, along), -np.einsum("tck,tk->tc", corners, up)], axis=2) / tile_m


def soup(corners: ArrayLike, material: Material, crease_deg: float = CREASE_DEG, tile_m: float = 1.0) -> MeshPart:
    """Return the part made of triangles (T, 3, 3), without the degenerate ones."""
    tri = np.asarray(corners, dtype=np.float64)
    tri = tri[np.linalg.norm(face_normals(tri), axis=1) > 1e-9]
    return MeshPart(tri, creased_normals(tri, crease_deg), slope_uv(tri, tile_m), material)


def grid(points: ArrayLike, material: Material, crease_deg: float = CREASE_DEG, tile_m: float = 1.0) -> MeshPart:
    """Return the surface through a lattice of points (N, M, 3); outward is (∂/∂rows) × (∂/∂columns)."""
    p = np.asarray(points, dtype=np.float64)
    return soup(lattice_triangles(p), material, crease_deg, tile_m)


def lattice_triangles(points: Array) -> Array:
    """Return the triangles (T, 3, K) of a lattice of points (N, M, K). Each cell is split from its first corner."""
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    halves = [np.stack(corners, axis=2).reshape(-1, 3, points.shape[2]) for corners in ((a, b, c), (a, c, d))]
    return np.concatenate(halves)


def quad(points: ArrayLike, material: Material) -> MeshPart:
    """Return one quadrilateral that shows the whole texture once.

    `points` (4, 3): lower left, lower right, upper right, upper left, as seen from outside.
    """
    p = np.asarray(points, dtype=np.float64)
    tri = np.stack([p[[0, 1, 2]], p[[0, 2, 3]]])
    square = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    uv = np.stack([square[[0, 1, 2]], square[[0, 2, 3]]])
    return MeshPart(tri, creased_normals(tri, 0.0), uv, material)


def panel(x: float, y: tuple[float, float], z: tuple[float, float], material: Material) -> MeshPart:
    """Return an upright rectangle that shows the whole texture once; it faces backward if y[0] > y[1], else forward."""
    (y0, y1), (z0, z1) = y, z
    return quad([(x, y0, z0), (x, y1, z0), (x, y1, z1), (x, y0, z1)], material)


def hull(
    bottom: ArrayLike, top: ArrayLike, material: Material, tile_m: float = 1.0, crease_deg: float = 20.0
) -> MeshPart:
    """Return the closed solid between two convex rings (N, 3), both counter-clockwise seen from above."""
    low, high = np.asarray(bottom, dtype=np.float64), np.asarray(top, dtype=np.float64)
    low2, high2 = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    sides = np.concatenate([np.stack([low, low2, high2], axis=1), np.stack([low, high2, high], axis=1)])
    count = len(low)
    fan = np.array([(0, k, k + 1) for k in range(1, count - 1)])
    return soup(np.concatenate([sides, high[fan], low[fan[:, ::-1]]]), material, crease_deg, tile_m)


def frustum(low: PlanRect, high: PlanRect, z: tuple[float, float], material: Material, tile_m: float = 1.0) -> MeshPart:
    """Return the closed solid between two level rectangles (lower and upper corner in x and y) at the heights `z`."""
    rings = [
        [(x0, y0, level), (x1, y0, level), (x1, y1, level), (x0, y1, level)]
        for ((x0, y0), (x1, y1)), level in zip((low, high), z, strict=True)
    ]
    return hull(rings[0], rings[1], material, tile_m)


_CUBE_NORMAL = np.repeat(face_normals(_CUBE)[:, None, :], 3, axis=1)


def box(low: ArrayLike, high: ArrayLike, material: Material, tile_m: float = 1.0) -> MeshPart:
    """Return the axis-aligned box between its lower and its upper corner."""
    a, b = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    corners = a + _CUBE * (b - a)
    return MeshPart(corners, _CUBE_NORMAL, np.matmul(corners, _CUBE_UV.transpose(0, 2, 1)) / tile_m, material)


def cap(ring: ArrayLike, material: Material, faces_back: bool = False) -> MeshPart:
    """Return a flat convex ring (N, 3); `faces_back`: it is counter-clockwise seen from the other side."""
    corners = np.asarray(ring, dtype=np.float64)
    step = -1 if faces_back else 1
    return soup(corners[[(0, k, k + 1)[::step] for k in range(1, len(corners) - 1)]], material, 0.0)


def prism(ring: ArrayLike, z0: float, z1: float, material: Material, tile_m: float = 1.0) -> MeshPart:
    """Return a convex footprint (N, 2), counter-clockwise seen from above, extruded from z0 to z1."""
    r = np.asarray(ring, dtype=np.float64)
    low = np.column_stack([r, np.full(len(r), z0)])
    return hull(low, low + np.array((0.0, 0.0, z1 - z0)), material, tile_m)


def profile(ring: ArrayLike, y0: float, y1: float, material: Material, tile_m: float = 1.0) -> MeshPart:
    """Return a convex side view (N, 2) in x and z, extruded from y0 to y1. The ring may run either way."""
    r = np.asarray(ring, dtype=np.float64)
    x, z = r[:, 0], r[:, 1]
    if np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z) < 0.0:
        r = r[::-1]
    # a prism turned by a quarter about x: its y becomes z, its z becomes -y
    flat = prism(r, 0.0, 1.0, material, tile_m).corners
    tri = np.stack([flat[..., 0], y0 + (y1 - y0) * (1.0 - flat[..., 2]), flat[..., 1]], axis=2)
    return soup(tri, material, 20.0, tile_m)


def lathe(outline: ArrayLike, material: Material, segments: int = 16, tile_m: float = 1.0) -> MeshPart:
    """Return the solid of revolution about z of an outline (N, 2) of radius and height, listed from bottom to top."""
    o = np.asarray(outline, dtype=np.float64)
    turn = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    points = np.stack(
        [
            np.outer(np.cos(turn), o[:, 0]),
            np.outer(np.sin(turn), o[:, 0]),
            np.broadcast_to(o[:, 1], (segments + 1, len(o))),
        ],
        axis=2,
    )
    return grid(points, material, tile_m=tile_m)


def rod(
    start: ArrayLike, end: ArrayLike, radii: tuple[float, float], material: Material, segments: int = 10
) -> MeshPart:
    """Return a cylinder or cone with closed ends from `start` to `end`; `radii` (m): at start and end."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    axis = (b - a) / np.linalg.norm(b - a)
    side = cross(axis, np.array((0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0)))
    side /= np.linalg.norm(side)
    third = cross(axis, side)
    turn = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.outer(np.cos(turn), side) + np.outer(np.sin(turn), third)
    return hull(a + radii[0] * ring, b + radii[1] * ring, material, crease_deg=50.0)


def ball(centre: ArrayLike, radii: ArrayLike, material: Material, level: int = 2, tile_m: float = 1.0) -> MeshPart:
    """Return an ellipsoid made of a subdivided icosahedron: 20 · 4**level triangles."""
    unit = _icosphere(level)
    tri = unit * np.asarray(radii, dtype=np.float64) + np.asarray(centre, dtype=np.float64)
    return soup(tri, material, 60.0, tile_m)


def _icosphere(level: int) -> Array:
    """Return the (T, 3, 3) triangles of a unit sphere."""
    g = (1.0 + 5.0**0.5) / 2.0
    v = np.array(
        [
            (-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g),
            (0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1),
        ],
        dtype=np.float64,
    )  # fmt: skip
    f = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6)]
    f += [(7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10)]
    f += [(8, 6, 7), (9, 8, 1)]
    tri = v[np.array(f)]
    for _ in range(level):
        a, b, c = tri[:, 0], tri[:, 1], tri[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        tri = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        tri /= np.linalg.norm(tri, axis=2, keepdims=True)
    return np.asarray(tri / np.linalg.norm(tri, axis=2, keepdims=True))


def roughened(part: MeshPart, amount: float, seed: int, wavelength_m: float = 0.7) -> MeshPart:
    """Return the part with its surface pushed in and out by about `amount` metres. A closed surface stays closed."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(6, 3)) * (2.0 * np.pi / wavelength_m / 1.7)
    phase = rng.uniform(0.0, 2.0 * np.pi, 6)
    push = np.sin(part.corners @ waves.T + phase).sum(axis=2, keepdims=True) / 3.0
    return soup(part.corners + amount * push * part.normals, part.material, 50.0)


def transformed(part: MeshPart, offset: ArrayLike = (0.0, 0.0, 0.0), yaw: float = 0.0) -> MeshPart:
    """Return the part turned by `yaw` (rad, counter-clockwise seen from above), then moved by `offset` (m)."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return replace(part, corners=part.corners @ turn + np.asarray(offset), normals=part.normals @ turn)


def without(part: MeshPart, *outward: Vec3) -> MeshPart:
    """Return the part without the triangles that face along a unit vector in `outward`, to leave out hidden sides."""
    area = face_normals(part.corners)
    kept = (area @ np.transpose(outward) < 0.999 * np.linalg.norm(area, axis=1, keepdims=True)).all(axis=1)
    return MeshPart(part.corners[kept], part.normals[kept], part.uv[kept], part.material)


def mirrored(part: MeshPart) -> MeshPart:
    """Return the part reflected left to right, still facing outwards."""
    flip = np.array([1.0, -1.0, 1.0])
    return MeshPart((part.corners * flip)[:, ::-1], (part.normals * flip)[:, ::-1], part.uv[:, ::-1], part.material)


def assemble(solids: Sequence[MeshPart]) -> Mesh:
    """Return the parts as one mesh in FRD axes, with equal corners merged."""
    place: dict[int, int] = {}
    which = [place.setdefault(id(part.material), len(place)) for part in solids]
    materials = list({id(part.material): part.material for part in solids}.values())
    material = np.repeat(np.array(which, dtype=np.int32), [len(p.corners) for p in solids])
    table = np.concatenate(
        [np.concatenate([p.corners, p.normals, p.uv], axis=2).reshape(-1, 8) for p in solids]
    ).astype(np.float32)
    table[:, [1, 2, 4, 5]] *= -1.0
    rows = np.ascontiguousarray(np.round(table * 1e4).astype(np.int32))
    _, index, inverse = np.unique(
        rows.view(np.dtype((np.void, rows.dtype.itemsize * 8))).ravel(), return_index=True, return_inverse=True
    )
    kept = table[index]
    return Mesh(
        vertices=np.ascontiguousarray(kept[:, 0:3]),
        normals=np.ascontiguousarray(kept[:, 3:6]),
        uv=np.ascontiguousarray(kept[:, 6:8]),
        triangles=inverse.reshape(-1, 3).astype(np.int32),
        material=material,
        materials=tuple(materials),
    )
