"""Builds the visible ground of the residential map: one mesh for each use (road, kerb, lawn …), on the terrain."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from episodes.maps import countryside
from episodes.maps import geometry as g
from episodes.maps.assets.materials import TRIM, WHITE_WOOD, surface
from episodes.maps.residential_plan import (
    CORNER,
    DEPTH,
    DRIVE_END,
    DRIVE_HALF,
    FLANK,
    LOWER,
    MAIN,
    RINGS,
    SECOND,
    STREETS,
    UPPER,
    Plot,
    away,
    height,
)
from episodes.maps.scene import Array, Material, Mesh
from foundation.terrain import HeightField

STEP_M = 5.0  # default spacing of the lattice
FAR_M = 420.0  # half extent of the zones; `countryside.beyond` draws the land farther out
WEST, EAST, NORTH = -62.0, 126.0, 104.0  # m, edges of the neighbourhood; the south edge is -NORTH
TINTS = ((1.0, 1.0, 1.0), (1.12, 1.06, 1.0), (0.86, 0.93, 0.9))  # factors on the colour of lawns

Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Use:
    """The material of one use of the ground, and how its texture is laid."""

    look: Material
    tile: float  # m per repeat
    shift: float = 0.0  # m from the street's centre line to the first joint of the slabs


def _uses() -> dict[str, _Use]:
    uses = {
        "road": _Use(surface("asphalt"), 4.0),
        "kerb": _Use(surface("concrete", (0.92, 0.92, 0.92)), 1.5),
        "pavement": _Use(surface("concrete"), 1.5, 5.5),
        "drive": _Use(surface("concrete", (0.82, 0.80, 0.77)), 2.3),
    }
    uses |= {f"lawn-{k}": _Use(surface("grass", tint), 4.0) for k, tint in enumerate(TINTS)}
    return uses | {"field": _Use(surface("grass", (1.0, 0.97, 0.95)), 11.0)}


def _between(a: float, b: float) -> tuple[float, float]:
    return min(a, b), max(a, b)


def _zones() -> Iterator[tuple[float, float, float, float, str]]:
    """Yield rectangles (n0, n1, e0, e1, kind of grass). With the round corners of `_corners`, they tile the ground."""
    inner, outer = UPPER.middle - CORNER, UPPER.middle
    back = UPPER.middle - DEPTH
    for street in (MAIN, SECOND):
        yield -inner, inner, street.middle - DEPTH, street.middle + DEPTH, "lawn"
    for s in (1.0, -1.0):
        yield *_between(s * outer, s * NORTH), WEST, EAST, "lawn"
        for e0, e1 in ((-DEPTH, -CORNER), (CORNER, 64.0 - CORNER), (64.0 + CORNER, 64.0 + DEPTH)):
            yield *_between(s * inner, s * outer), e0, e1, "lawn"
        yield *_between(s * back, s * outer), WEST, -DEPTH, "lawn"
        yield *_between(s * back, s * outer), 64.0 + DEPTH, EAST, "lawn"
        yield *_between(s * NORTH, s * FAR_M), -FAR_M, FAR_M, "field"
    yield -back, back, WEST, -DEPTH, "field"
    yield -back, back, 64.0 + DEPTH, EAST, "field"
    yield -NORTH, NORTH, -FAR_M, WEST, "field"
    yield -NORTH, NORTH, EAST, FAR_M, "field"


def _nodes(low: float, high: float, across: tuple[float, float], north: bool, homes: tuple[Plot, ...]) -> Array:
    """Return a zone's lattice coordinates (m) along one axis; `across` is the zone's range along the other axis."""
    cuts: list[float] = [low, high]
    if high - low < 2 * FAR_M - 1.0 and abs(low) < FAR_M and abs(high) < FAR_M:
        cuts += np.arange(np.ceil(low / STEP_M) * STEP_M, high, STEP_M).tolist()
    else:
        cuts += [x for x in (-220.0, -140.0, *np.arange(-100.0, 121.0, 20.0).tolist(), 160.0, 240.0) if low < x < high]
    if not north:
        cuts += np.arange(23.0, 41.1, 2.0).tolist()  # finer, because the slope to the east is curved here
    rings = (0.0, *RINGS, DRIVE_END)
    for street in STREETS:
        if street.north is not north and across[0] < street.ends[1] + CORNER and across[1] > street.ends[0] - CORNER:
            cuts += [street.middle + s * r for r in rings for s in (-1, 1)]
        if street.north is north and street.dead and across[0] <= street.middle <= across[1]:
            cuts += [end + s * (r - RINGS[0]) for r in RINGS for end, s in zip(street.ends, (-1, 1), strict=True)]
    for plot in homes:
        if plot.street.north is north:
            edge = sorted((plot.street.middle, plot.street.middle + plot.side * DRIVE_END))
            if across[0] < edge[1] and across[1] > edge[0]:
                cuts += [plot.drive + s * (DRIVE_HALF + d) for s in (-1, 1) for d in (0.0, FLANK)]
    return np.unique(np.round([c for c in cuts if low <= c <= high], 3))


def _drives_and_tints(north: Array, east: Array, homes: tuple[Plot, ...]) -> tuple[Mask, NDArray[np.int_]]:
    """Return which points lie on a drive, from the kerb to the house, and the index in TINTS of the grass at points.

    Each plot has one tint.
    """
    shape = np.broadcast(north, east).shape
    is_drive, tint = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=int)
    for plot in homes:
        along, out = plot.from_street(north, east)
        is_drive |= (np.abs(along - plot.drive) < DRIVE_HALF) & (out > RINGS[0]) & (out < DRIVE_END)
        tint[(np.abs(along - plot.along) < 10.0) & (out > 0.0) & (out < DEPTH)] = plot.number // 2 * 2 % 3
    return is_drive, tint


def _cells(zone: tuple[float, float, float, float, str], homes: tuple[Plot, ...]) -> Iterator[tuple[str, Array]]:
    """Yield (use, corners (T, 3, 3) FLU) of one zone. Each cell is split along the diagonal nearer to the ground."""
    n0, n1, e0, e1, grass = zone
    north, east = _nodes(n0, n1, (e0, e1), True, homes), _nodes(e0, e1, (n0, n1), False, homes)
    z = height(north[:, None], east[None, :], homes)
    n, e = np.broadcast_arrays(north[:, None], east[None, :])
    lattice = np.stack([n, -e, -z], axis=2)  # FLU: forward is north, left is west
    mid_n, mid_e = (north[:-1, None] + north[1:, None]) / 2, (east[None, :-1] + east[None, 1:]) / 2
    a, b, c, d = lattice[:-1, :-1], lattice[1:, :-1], lattice[1:, 1:], lattice[:-1, 1:]
    middle = -height(mid_n, mid_e, homes)
    ac = np.abs((a + c)[..., 2] / 2 - middle) <= np.abs((b + d)[..., 2] / 2 - middle) + 1e-6
    # columns run east, i.e. towards -y: a, d, c, b is counter-clockwise seen from above
    first = np.where(ac[..., None, None], np.stack([a, d, c], axis=2), np.stack([a, d, b], axis=2))
    second = np.where(ac[..., None, None], np.stack([a, c, b], axis=2), np.stack([b, d, c], axis=2))
    run = away(mid_n, mid_e)
    drive, tint = _drives_and_tints(mid_n, mid_e, homes)
    uses = {
        "road": run < RINGS[0],
        "kerb": (run > RINGS[0]) & (run < RINGS[1]) & ~drive,
        "pavement": (run > RINGS[2]) & (run < RINGS[3]),
    }
    taken = np.logical_or.reduce(list(uses.values()))
    uses["drive"] = drive & ~taken
    green = ~(taken | drive)
    if grass == "field":
        uses["field"] = green
    else:
        uses |= {f"lawn-{k}": green & (tint == k) for k in range(len(TINTS))}
    for name, mask in uses.items():
        if mask.any():
            yield name, np.concatenate([first[mask], second[mask]])


def _corners(homes: tuple[Plot, ...]) -> Iterator[tuple[str, Array, Array]]:
    """Yield (use, vertices, texture coordinates in metres) of the round street corners, from the lawn to the road."""
    turn = np.linspace(0.0, np.pi / 2, 9)
    square = CORNER / np.maximum(np.cos(turn), np.sin(turn))
    rings = [np.zeros(9)] + [np.full(9, CORNER - r) for r in RINGS[-2::-1]] + [square]
    names = ("lawn-0", "lawn-0", "pavement", "lawn-0", "kerb", "road")
    for (street, cross), way in itertools.product(itertools.product((MAIN, SECOND), (UPPER, LOWER)), (-1.0, 1.0)):
        inward = -np.sign(cross.middle)
        points = []
        for radius in rings:
            n = cross.middle + inward * (CORNER - radius * np.cos(turn))
            e = street.middle + way * (CORNER - radius * np.sin(turn))
            points.append(np.stack([n, -e, -np.diag(height(n[:, None], e[None, :], homes))], axis=1))
        for name, (k, (low, high)) in zip(names, enumerate(itertools.pairwise(points)), strict=True):
            quad = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
            tri = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
            arc = 3.25 * np.stack([turn[:-1], turn[1:], turn[1:], turn[:-1]], axis=1)
            out = np.stack([rings[k][:-1], rings[k][1:], rings[k + 1][1:], rings[k + 1][:-1]], axis=1)
            flat = np.stack([arc, 4.0 - out], axis=2)
            uv = np.concatenate([flat[:, [0, 1, 2]], flat[:, [0, 2, 3]]])
            if inward * way < 0.0:
                tri, uv = tri[:, ::-1], uv[:, ::-1]
            yield name, tri, uv if name == "pavement" else np.stack([tri[..., 0], -tri[..., 1]], axis=2)


def _in_plan(tri: Array, shift: float) -> Array:
    """Return texture coordinates (m): along the nearer street, and the distance from its centre line minus `shift`."""
    n, e = tri[..., 0], -tri[..., 1]
    mid_n, mid_e = n.mean(axis=1, keepdims=True), e.mean(axis=1, keepdims=True)
    to_north = np.minimum.reduce([np.abs(mid_e - s.middle) for s in STREETS if s.north])
    to_east = np.minimum.reduce([np.abs(mid_n - s.middle) for s in STREETS if not s.north])
    north = (to_north < to_east) & (np.abs(mid_n) < UPPER.middle - CORNER)
    nearest = np.where(np.abs(mid_e) < 32.0, 0.0, SECOND.middle)
    upper = np.where(mid_n > 0.0, UPPER.middle, LOWER.middle)
    along = np.where(north, n, e)
    out = np.where(north, np.abs(e - nearest), np.abs(n - upper))
    return np.stack([along, out - shift], axis=2)


def ground(homes: tuple[Plot, ...]) -> list[tuple[str, Mesh]]:
    """Return (use, mesh) of all ground, and of a sheet below the ground that closes the hair cracks between zones."""
    uses = _uses()
    pieces: dict[str, list[tuple[Array, Array]]] = {name: [] for name in uses}
    for zone in _zones():
        for name, tri in _cells(zone, homes):
            pieces[name].append((tri, _in_plan(tri, uses[name].shift)))
    for name, tri, flat in _corners(homes):
        pieces[name].append((tri, flat))
    made = []
    for name, use in uses.items():
        tri = np.concatenate([piece[0] for piece in pieces[name]])
        part = g.soup(tri, use.look, 25.0, use.tile)
        flat = np.concatenate([piece[1] for piece in pieces[name]])
        keep = np.linalg.norm(g.face_normals(tri), axis=1) > 1e-9  # the same filter as in `soup`
        parts = [replace(part, uv=flat[keep] / use.tile)]
        if name == "field":
            parts.append(countryside.beyond(FAR_M, lambda north, east: height(north, east, homes), 2))
        made.append((name, g.assemble(parts)))
    sheet = [(-130.0, 150.0), (-130.0, -90.0), (130.0, -90.0), (130.0, 150.0)]
    flat_sheet = g.soup([[(*sheet[i], -0.3) for i in ring] for ring in ((0, 1, 2), (0, 2, 3))], uses["field"].look)
    return [*made, ("subsoil", g.assemble([flat_sheet]))]


def markings(ground_at: HeightField) -> Mesh:
    """Return dashed centre lines, stop lines, crossings and manhole covers, a few millimetres above the road."""
    solids = []

    def strip(n0: float, n1: float, e0: float, e1: float, look: Material = WHITE_WOOD, lift: float = 0.008) -> None:
        ring = ((n0, e0), (n0, e1), (n1, e1), (n1, e0))
        solids.append(g.quad([(n, -e, lift - ground_at.at(n, e)) for n, e in ring], look))

    for street in STREETS:
        joins = [s.middle for s in STREETS if s.north is not street.north]
        for a in np.arange(street.ends[0] + (2.0 if street.dead else 13.0), street.ends[1] - 5.0, 9.0):
            if all(abs(a + 1.5 - j) > 11.0 for j in joins):
                (n0, e0), (n1, e1) = street.at(a, -0.06), street.at(a + 3.0, 0.06)
                strip(n0, n1, e0, e1)
    for street, s in itertools.product((MAIN, SECOND), (-1, 1)):
        low, high = sorted((0.2 * s, 3.8 * s))  # the stop line covers the right lane only
        near = s * (UPPER.middle - 7.6)
        strip(near - 0.2, near + 0.2, street.middle + low, street.middle + high)
    for middle, n in ((MAIN.middle, 19.0), (SECOND.middle, -21.0)):
        for e in np.arange(-3.7, 3.6, 1.0):
            strip(n, n + 2.6, middle + e, middle + e + 0.5)
    for n, e in ((-41.0, 1.1), (12.5, -1.0), (51.0, 1.2), (-4.0, 65.1), (38.0, 62.9), (72.8, 31.0), (-71.0, 88.0)):
        turn = 2.0 * np.pi * np.arange(12) / 12
        ring = [
            (n + 0.32 * c, -e + 0.32 * s, 0.006 - ground_at.at(n, e))
            for c, s in zip(np.cos(turn), np.sin(turn), strict=True)
        ]
        solids.append(g.cap(ring, TRIM))
    return g.assemble(solids)
