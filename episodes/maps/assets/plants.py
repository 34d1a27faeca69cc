"""Builds meshes of trees, shrubs and hedges.

A plant has dark solid cores with cut-out sprigs of leaves around them; a tree also has a trunk. The crown is made of
lobes (ellipsoids). A sprig is lit like its lobe. Vehicles pass through sprigs, but collide with trunks, branches and
cores. Lengths in `Species` are shares of the tree's height.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets.leaves import bark, leaves, thicket
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Array, Material, Mesh

BARK_TILE_M = 0.8
HIDDEN_WITHIN = 0.80  # sprigs within this share of another lobe's radii are hidden, and left out
LOWEST_M = 0.1  # least height of the middle of a sprig


@dataclass(frozen=True, slots=True, eq=False)
class Lobe:
    """An ellipsoid of a crown."""

    centre: Array  # (3,) FLU; m, or shares of the tree's height in `Species.lobes`
    radii: Array  # (3,) half axes, in the unit of `centre`


@dataclass(frozen=True, slots=True)
class Species:
    """The shape of a species of tree."""

    lobes: Callable[[np.random.Generator], list[Lobe]]
    sprig: float  # width of a sprig
    density: float  # sprigs per `sprig`² of the crown's surface
    inside: float  # size of the solid core of a lobe, as a share of the lobe
    thick: float  # radius of the trunk
    fork: float  # height at which branches begin
    hang: float = 0.0  # 0: sprigs point up and outwards … 1: down


def _lobe(turn: float, out: float, up: float, wide: float, high: float) -> Lobe:
    return Lobe(np.array((out * np.cos(turn), out * np.sin(turn), up)), np.array((wide, wide, high)))


def _ring(rng: np.random.Generator, count: int, out: float, up: float, wide: float, high: float) -> list[Lobe]:
    """Return `count` lobes around the trunk, with random differences."""
    turns = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.25, 0.25, count)) / count + rng.uniform(0.0, 6.0)
    return [
        _lobe(t, out * rng.uniform(0.8, 1.1), up + rng.uniform(-0.05, 0.05), wide * k, high * k)
        for t, k in zip(turns.tolist(), rng.uniform(0.85, 1.12, count).tolist(), strict=True)
    ]


def _oak(rng: np.random.Generator) -> list[Lobe]:
    """Return a broad, billowing crown."""
    return [
        *_ring(rng, 5, 0.21, 0.56, 0.150, 0.125),
        *_ring(rng, 3, 0.11, 0.74, 0.150, 0.130),
        _lobe(0.0, 0.0, 0.63, 0.20, 0.18),
        _lobe(rng.uniform(0, 6), 0.04, 0.86, 0.125, 0.105),
    ]


def _maple(rng: np.random.Generator) -> list[Lobe]:
    """Return a dense, egg-shaped crown."""
    return [
        *_ring(rng, 5, 0.145, 0.48, 0.125, 0.115),
        *_ring(rng, 4, 0.125, 0.67, 0.130, 0.130),
        _lobe(0.0, 0.0, 0.58, 0.18, 0.22),
        _lobe(rng.uniform(0, 6), 0.02, 0.845, 0.125, 0.145),
    ]


def _linden(rng: np.random.Generator) -> list[Lobe]:
    """Return a tall, drop-shaped crown, widest near its lower end."""
    stack = ((0.38, 0.18, 0.10), (0.50, 0.215, 0.13), (0.64, 0.185, 0.13), (0.78, 0.135, 0.13), (0.90, 0.075, 0.095))
    return [_lobe(rng.uniform(0, 6), rng.uniform(0.0, 0.035), up, w * rng.uniform(0.93, 1.07), h) for up, w, h in stack]


def _birch(rng: np.random.Generator) -> list[Lobe]:
    """Return a slender, light crown with hanging twigs."""
    return [
        *_ring(rng, 4, 0.115, 0.47, 0.085, 0.130),
        *_ring(rng, 3, 0.085, 0.66, 0.085, 0.125),
        _lobe(rng.uniform(0, 6), 0.02, 0.60, 0.085, 0.16),
        _lobe(rng.uniform(0, 6), 0.02, 0.85, 0.075, 0.135),
    ]


def _poplar(rng: np.random.Generator) -> list[Lobe]:
    """Return a column-shaped crown."""
    stack = ((0.22, 0.075), (0.36, 0.100), (0.51, 0.108), (0.66, 0.100), (0.80, 0.080), (0.92, 0.050))
    return [_lobe(rng.uniform(0, 6), rng.uniform(0.0, 0.018), up, w * rng.uniform(0.9, 1.1), 0.115) for up, w in stack]


def _pine(rng: np.random.Generator) -> list[Lobe]:
    """Return flat lobes high up, at the ends of a few branches."""
    return [
        *_ring(rng, 3, 0.135, 0.56, 0.095, 0.050),
        *_ring(rng, 4, 0.115, 0.74, 0.110, 0.060),
        _lobe(rng.uniform(0, 6), 0.03, 0.84, 0.115, 0.075),
        _lobe(rng.uniform(0, 6), 0.03, 0.93, 0.075, 0.060),
    ]


SPECIES: dict[str, Species] = {
    "oak": Species(_oak, 0.150, 1.05, 0.80, 0.026, 0.32),
    "maple": Species(_maple, 0.135, 1.05, 0.82, 0.021, 0.30),
    "linden": Species(_linden, 0.130, 1.15, 0.84, 0.022, 0.26),
    "birch": Species(_birch, 0.115, 1.20, 0.55, 0.014, 0.30, 0.75),
    "poplar": Species(_poplar, 0.105, 1.20, 0.78, 0.018, 0.12),
    "pine": Species(_pine, 0.110, 1.55, 0.70, 0.018, 0.46),
}
BROADLEAVES = ("oak", "maple", "birch", "linden", "poplar")


@lru_cache(maxsize=256)
def tree(species: str = "oak", height: float = 8.0, seed: int = 1) -> Mesh:
    """Return a tree of SPECIES. The seed varies its shape, and scales its height by 0.92 … 1.02."""
    rng = np.random.default_rng((seed, *species.encode()))
    kind = SPECIES[species]
    height *= float(rng.uniform(0.92, 1.02))
    lobes = [Lobe(lobe.centre * height, lobe.radii * height) for lobe in kind.lobes(rng)]
    wood, thick = bark(species), kind.thick * height + 0.03
    top = 0.86 * max(lobe.centre[2] for lobe in lobes)
    lean = rng.normal(size=2) * 0.008 * height
    trunk = [(0, 0, -0.25), (0, 0, 0.12), (0, 0, 0.5), (*lean, kind.fork * height), (*(1.5 * lean), top)]
    solids = [_limb(trunk, [thick * k for k in (1.9, 1.3, 1.0, 0.8, 0.25)], wood, 9)]
    for lobe in lobes:
        if np.hypot(*lobe.centre[:2]) > 0.05 * height:
            foot = np.array((*lean, max(kind.fork * height * 0.95, lobe.centre[2] - 0.2 * height)))
            elbow = 0.5 * (foot + lobe.centre) + (0, 0, -0.03 * height)
            solids.append(_limb([foot, elbow, lobe.centre], [thick * k for k in (0.5, 0.35, 0.15)], wood, 5))
    solids += [_inside(lobe, kind.inside, thicket(species), rng) for lobe in lobes]
    solids.append(_sprigs(lobes, kind.sprig * height, kind.density, kind.hang, leaves(species), rng))
    return g.assemble(solids)


@lru_cache(maxsize=64)
def conifer(height: float = 9.0, seed: int = 1) -> Mesh:
    """Return a conifer: every third seed is a pine, the others are spruces."""
    return tree("pine", height, seed) if seed % 3 == 0 else spruce(height, seed)


@lru_cache(maxsize=64)
def spruce(height: float = 9.0, seed: int = 1) -> Mesh:
    """Return a spruce: whorls of hanging branches around a straight trunk."""
    rng, leaf = np.random.default_rng((seed, 7)), leaves("spruce")
    height *= float(rng.uniform(0.92, 1.0))
    slim = float(rng.uniform(0.85, 1.05))
    wood = bark("spruce")
    solids = [
        _limb([(0, 0, -0.25), (0, 0, 0.3), (0, 0, 0.93 * height)], [0.026 * height, 0.018 * height, 0.02], wood, 8)
    ]

    def reach(share: float) -> float:
        return float(slim * (0.215 * height * (1.0 - share) ** 0.85 + 0.06))

    rings = np.array([0.13, 0.14, 0.45, 0.75, 0.96])
    turns = np.linspace(0.0, 2.0 * np.pi, 10)
    cone = np.array(
        [[(0.42 * reach(z) * w * np.cos(t), 0.42 * reach(z) * w * np.sin(t), z * height) for z, w in zip(
            rings, (0.1, 1.0, 1.0, 1.0, 0.0), strict=True)] for t in turns]
    )  # fmt: skip
    solids.append(g.grid(cone, thicket("spruce"), 80.0, 1.2))
    corners, normals, uv = [], [], []
    whorls = 15
    for k in range(whorls):
        share = 0.09 + 0.83 * (k / (whorls - 1)) ** 0.92
        long, count = reach(share), max(5, round(11 * (1.0 - share) + 2))
        for turn in (2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count + 1.3 * k).tolist():
            away = np.array((np.cos(turn), np.sin(turn), 0.0))
            along = long * rng.uniform(0.85, 1.12)
            droop = rng.uniform(0.35, 0.55) if share < 0.8 else rng.uniform(-0.6, 0.1)
            foot = (
                np.array((0.0, 0.0, (share + rng.uniform(-0.02, 0.02)) * height + 0.25 * along)) + 0.08 * along * away
            )
            tip = foot + along * (away - (0, 0, droop))
            roll = rng.uniform(-0.8, 0.8)
            side = np.cross(away, (0.0, 0.0, 1.0)) * np.cos(roll) + np.array((0.0, 0.0, np.sin(roll)))
            half = 0.5 * max(min(0.75 * along, 1.0), 0.35) * side
            quad = np.array([foot - half, foot + half, tip + half, tip - half])
            out = quad * (1.0, 1.0, 0.0) + (0.0, 0.0, 0.25 * along)
            corners.append(quad)
            normals.append(out / np.linalg.norm(out, axis=1, keepdims=True))
            uv.append(_cell(rng))
    top = 0.05 * height
    for turn in (0.3, 1.9, 3.4):  # the topmost shoot
        side = np.array((np.cos(turn), np.sin(turn), 0.0)) * top * 0.6
        quad = np.array([(0, 0, 0.90 * height)] * 2 + [(0, 0, height)] * 2) + np.array([-side, side, side, -side])
        corners.append(quad)
        out = np.array([(*(s / np.linalg.norm(s))[:2], 0.4) for s in (-side, side, side, -side)])
        normals.append(out / np.linalg.norm(out, axis=1, keepdims=True))
        uv.append(_cell(rng))
    solids.append(_cards(np.array(corners), np.array(normals), np.array(uv), leaf))
    return g.assemble(solids)


@lru_cache(maxsize=64)
def bush(radius: float = 0.6, seed: int = 1) -> Mesh:
    """Return a garden shrub. The seed selects a clipped box, an upright lilac or a spreading spirea."""
    rng = np.random.default_rng((seed, 5))
    species = ("box", "lilac", "spirea")[seed % 3]
    wide, high = {"box": (1.0, 0.86), "lilac": (0.82, 1.12), "spirea": (1.12, 0.72)}[species]
    if species == "box":
        lobes = [Lobe(np.array((0, 0, radius * 0.72)), np.array((wide, wide, high)) * radius)]
    else:
        middle = Lobe(np.array((0, 0, radius * high * 0.75)), np.array((0.72 * wide, 0.72 * wide, high)) * radius)
        lobes = [middle, *_ring(rng, 4, 0.45 * wide * radius, 0.5 * high * radius, 0.5 * radius, 0.5 * high * radius)]
    sprig, density = {"box": (0.55, 1.6), "lilac": (0.8, 1.2), "spirea": (0.7, 1.4)}[species]
    return g.assemble(shrubbery(lobes, species, sprig * radius, density, rng))


def shrubbery(
    lobes: Sequence[Lobe], species: str, sprig_m: float, density: float, rng: np.random.Generator
) -> list[MeshPart]:
    """Return the cores and the sprigs of a shrub."""
    solids = [_inside(lobe, 0.84, thicket(species), rng) for lobe in lobes]
    return [*solids, _sprigs(lobes, sprig_m, density, 0.0, leaves(species), rng, low=-0.35)]


@lru_cache(maxsize=64)
def hedge(length: float = 6.0, height: float = 1.2, thick: float = 0.8, seed: int = 1) -> Mesh:
    """Return a clipped hedge along the forward axis."""
    rng, leaf = np.random.default_rng((seed, 6)), leaves("box")
    half = np.array((length / 2, thick / 2))
    inset = 0.07
    x, y, z = half[0] - inset, half[1] - inset, height - inset
    solids = [g.box((-x, -y, 0.0), (x, y, z), thicket("box"), 1.2)]
    sprig = 0.36
    count = int(1.35 * (2 * (length + thick) * height + length * thick) / sprig**2)
    areas = np.array([length * height, length * height, thick * height, thick * height, length * thick])
    face = rng.choice(5, count, p=areas / areas.sum())
    axes = np.array([(0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)], float)[face]
    at = rng.uniform(-1.0, 1.0, (count, 3)) * (*half, height / 2) + (0.0, 0.0, height / 2)
    low, high = np.array((-half[0], -half[1], 0.0)), np.array((half[0], half[1], height))
    at = np.where(axes > 0, high - 0.05, np.where(axes < 0, low + 0.05, at))
    at[:, 2] = np.maximum(at[:, 2], 0.3 * sprig)
    middle = np.array((0.0, 0.0, 0.55 * height))
    rounded = (at - middle) / np.array((length, 0.9 * thick, height)) * (0.15, 0.5, 0.5) + 0.8 * axes
    quads = _quads(at, axes, np.tile((0.0, 0.0, 1.0), (count, 1)), sprig * rng.uniform(0.8, 1.2, count), 0.45, rng)
    normals = np.repeat((rounded / np.linalg.norm(rounded, axis=1, keepdims=True))[:, None], 4, axis=1)
    solids.append(_cards(quads, normals, np.array([_cell(rng) for _ in range(count)]), leaf))
    return g.assemble(solids)


@lru_cache(maxsize=16)
def wood(length: float = 60.0, height: float = 9.0, seed: int = 1) -> Mesh:
    """Return the edge of a wood along the forward axis, for views from far away. Its crowns reach to the ground."""
    rng = np.random.default_rng((seed, 8))
    insides: list[MeshPart] = []
    by_species: dict[str, list[Lobe]] = {"oak": [], "linden": [], "maple": [], "birch": [], "spruce": []}
    for row, y in enumerate((-1.9, 1.9)):
        for x in np.arange(-length / 2 + (1.0, 3.4)[row], length / 2, 4.8).tolist():
            species = str(rng.choice(list(by_species), p=(0.28, 0.2, 0.24, 0.13, 0.15)))
            tall = height * rng.uniform(0.62, 1.0)
            at = np.array((x + rng.uniform(-1.0, 1.0), y + rng.uniform(-0.9, 0.9), 0.0))
            if species == "spruce":
                wide = 1.7
                parts = [(0.32, 1.9, 0.34), (0.64, 1.2, 0.26), (0.88, 0.5, 0.14)]
            else:
                wide = rng.uniform(1.9, 2.7) * (0.75 if species == "birch" else 1.0)
                parts = [(0.30, 0.92 * wide, 0.32), (0.66, wide, 0.32)]
            by_species[species] += [
                Lobe(at + np.array((0, 0, up * tall)), np.array((w, w, h * tall))) for up, w, h in parts
            ]
            middle = Lobe(at + np.array((0, 0, 0.40 * tall)), np.array((0.8 * wide, 0.8 * wide, 0.44 * tall)))
            insides.append(_inside(middle, 0.92, thicket(species), rng))
    # sorted from one end to the other: the renderer culls consecutive triangles together, so they should be close
    groups: dict[tuple[int, str], list[Lobe]] = {}
    for species, lobes in by_species.items():
        for lobe in lobes:
            groups.setdefault((int(lobe.centre[0] // 12.0), species), []).append(lobe)
    every = [lobe for lobes in by_species.values() for lobe in lobes]
    sprigs = []
    for (_, species), lobes in sorted(groups.items(), key=lambda group: group[0]):
        wide, hang = (1.9, 0.6) if species == "spruce" else (2.4, 0.0)
        others = [lobe for lobe in every if lobe not in lobes]
        sprigs.append(_sprigs(lobes, wide, 0.72, hang, leaves(species), rng, beside=others))
    return g.assemble([*insides, *sprigs])


def _limb(line: Sequence[Sequence[float] | Array], radii: Sequence[float], material: Material, sides: int) -> MeshPart:
    """Return a trunk or branch through some points, wrapped in its bark, with both ends open."""
    points = np.array([np.asarray(p, float) for p in line])
    ways = np.gradient(points, axis=0)
    turn = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    rings = []
    for point, way, radius in zip(points, ways, radii, strict=True):
        way = way / np.linalg.norm(way)
        side = np.cross(way, (1.0, 0.0, 0.0) if abs(way[0]) < 0.7 else (0.0, 1.0, 0.0))
        side /= np.linalg.norm(side)
        third = np.cross(way, side)
        rings.append(point + radius * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), third)))
    lattice = np.array(rings).transpose(1, 0, 2)
    part = g.grid(lattice, material, 60.0)
    # a whole number of repeats around, so that the bark has no seam
    repeats = max(1, round(2.0 * np.pi * max(radii[1:]) / BARK_TILE_M))
    down = -np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]) / BARK_TILE_M
    uv = np.stack(np.broadcast_arrays(np.linspace(0.0, repeats, sides + 1)[:, None], down[None]), axis=2)
    return replace(part, uv=g.lattice_triangles(uv))


def _inside(lobe: Lobe, share: float, material: Material, rng: np.random.Generator) -> MeshPart:
    """Return the solid core of a lobe."""
    ball = g.ball(lobe.centre, share * lobe.radii, material, 0, 1.2)
    mean = float(np.mean(lobe.radii))
    return replace(g.roughened(ball, 0.08 * mean, int(rng.integers(1 << 30)), mean), uv=ball.uv)


def _sprigs(
    lobes: Sequence[Lobe],
    width: float,
    density: float,
    hang: float,
    material: Material,
    rng: np.random.Generator,
    low: float = -1.0,
    beside: Sequence[Lobe] = (),
) -> MeshPart:
    """Return sprigs on the surface of a crown, except inside its other lobes or the lobes in `beside`.

    `low`: lowest position of sprigs on a lobe, from -1 (its bottom) to 1 (its top).
    """
    middles, radii = np.array([k.centre for k in lobes]), np.array([k.radii for k in lobes])
    crown = middles.mean(axis=0)
    around = np.concatenate([middles, *(k.centre[None] for k in beside)])
    sizes_around = np.concatenate([radii, *(k.radii[None] for k in beside)])
    at, out, of = [], [], []
    for k, lobe in enumerate(lobes):
        area = 4.0 * np.pi * float(np.mean(lobe.radii)) ** 2
        count = max(3, round(density * area / width**2))
        # spread evenly over the sphere by the golden angle
        z = np.maximum(1.0 - 2.0 * (np.arange(count) + rng.uniform(0.2, 0.8, count)) / count, low)
        turn = np.arange(count) * 2.399963 + rng.uniform(0.0, 6.0)
        flat = np.sqrt(np.maximum(1.0 - z * z, 0.0))
        ways = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
        places = lobe.centre + ways * lobe.radii * rng.uniform(0.80, 0.98, (count, 1))
        depth = np.linalg.norm((places[:, None] - around) / sizes_around, axis=2)
        depth[:, k] = np.inf
        shown = (depth.min(axis=1) > HIDDEN_WITHIN) & (places[:, 2] > LOWEST_M)
        at.append(places[shown])
        out.append(ways[shown])
        of += [k] * int(shown.sum())
    places, ways, own = np.concatenate(at), np.concatenate(out), np.array(of)
    up = np.array((0.0, 0.0, 1.0)) * (1.0 - 2.0 * hang) + 0.7 * ways
    sizes = width * rng.uniform(0.8, 1.2, len(places))
    quads = _quads(places, ways, up, sizes, 0.75, rng)
    normals = 0.65 * (quads - middles[own][:, None]) / radii[own][:, None]
    normals += 0.35 * (quads - crown) / np.linalg.norm(quads - crown, axis=2).max()
    normals += (0.0, 0.0, 0.12)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    return _cards(quads, normals, np.array([_cell(rng) for _ in places]), material)


def _quads(at: Array, out: Array, up: Array, sizes: Array, tilt: float, rng: np.random.Generator) -> Array:
    """Return randomly tilted squares (N, 4, 3) around `at` (N, 3). They face `out`; their upper edges point to `up`."""
    # the factor 0.6 keeps the squares upright, because cameras would see level squares on a crown edge-on
    face = out * (1.0, 1.0, 0.6) + tilt * rng.normal(size=out.shape) * (1.0, 1.0, 0.6)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    up = up + 0.45 * rng.normal(size=up.shape)
    side = np.cross(up, face)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    rise = np.cross(face, side)
    half = 0.5 * sizes[:, None, None]
    return np.asarray(
        at[:, None]
        + half
        * (side[:, None] * np.array((-1, 1, 1, -1.0))[:, None] + rise[:, None] * np.array((-1, -1, 1, 1.0))[:, None])
    )


def _cell(rng: np.random.Generator) -> Array:
    """Return the texture coordinates (4, 2) of one of the texture's four sprigs. Sprig and mirroring are random."""
    left, top = int(rng.integers(2)) / 2, int(rng.integers(2)) / 2
    a, b = (left, left + 0.5) if rng.random() < 0.5 else (left + 0.5, left)
    return np.array([(a, top + 0.5), (b, top + 0.5), (b, top), (a, top)])


def _cards(quads: Array, normals: Array, uv: Array, material: Material) -> MeshPart:
    """Return squares (N, 4, 3) with normals and texture coordinates at their corners as one part."""
    order = np.array(((0, 1, 2), (0, 2, 3)))
    return MeshPart(
        quads[:, order].reshape(-1, 3, 3), normals[:, order].reshape(-1, 3, 3), uv[:, order].reshape(-1, 3, 2), material
    )
