"""Builds the fixtures of the campus: benches, lamps, bins and racks, fountains, statues, kiosks and the clock tower.

All fixtures of a kind look the same. Each faces forward and has its origin on the ground under its middle.
"""

import itertools
from collections.abc import Callable
from functools import cache
from typing import TypeVar, cast

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials, plants
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Array, Material, Mesh

IRON = materials.plain("campus-iron", (48, 52, 54), 0.3)
CAST = materials.plain("cast-concrete", (172, 168, 160))
SLATS = surface("boards", (1.15, 1.08, 1.0), 0.05)
SINK = 0.06  # m; feet reach this far into the ground, so that they touch slopes

WATER = materials.plain("water", (84, 124, 138), 0.85)
SPRAY = materials.plain("spray", (206, 220, 226), 0.3, 0.06)
BRONZE = materials.plain("bronze", (86, 92, 78), 0.35)

Build = TypeVar("Build", bound=Callable[..., Mesh])
FIXTURES: dict[str, Callable[[], Mesh]] = {}  # kind of fixture → function that builds its mesh


def fixture(build: Build) -> Build:
    """Add the function that builds a fixture to FIXTURES, and keep its meshes."""
    FIXTURES[build.__name__.replace("_", "-")] = kept = cast(Build, cache(build))
    return kept


@fixture
def bench() -> Mesh:
    """Return a long bench: timber seat and back on two cast blocks."""
    solids = [g.box((-0.24, y - 0.17, -SINK), (0.28, y + 0.17, 0.40), CAST) for y in (-0.95, 0.95)]
    solids += [g.box((x, -1.3, 0.40), (x + 0.155, 1.3, 0.46), SLATS, 1.2) for x in (-0.20, -0.03, 0.14)]
    for low, lean in ((0.50, 0.0), (0.66, 0.035), (0.82, 0.07)):
        x = -0.22 - lean
        solids.append(g.box((x - 0.025, -1.3, low), (x + 0.025, 1.3, low + 0.135), SLATS, 1.2))
    for y in (-0.95, 0.0, 0.95):
        ring = [(-0.24, 0.30), (-0.29, 0.30), (-0.36, 0.97), (-0.31, 0.97)]
        solids.append(g.profile(ring, y - 0.035, y + 0.035, IRON))
    for y in (-1.22, 1.22):
        solids.append(g.box((-0.26, y - 0.03, 0.64), (0.26, y + 0.03, 0.68), IRON))
        solids.append(g.box((0.20, y - 0.03, 0.40), (0.25, y + 0.03, 0.64), IRON))
    return g.assemble(solids)


@fixture
def lamp(height: float = 4.6) -> Mesh:
    """Return a lamp post with a lantern on either side and a plain banner at the front."""
    glass = materials.plain("lantern", (240, 236, 216), 0.4, 0.25)
    cloth = materials.plain("banner", (62, 70, 92))
    solids = [
        g.lathe([(0.0, -SINK), (0.24, -SINK), (0.24, 0.12), (0.15, 0.2), (0.12, 0.75), (0.075, 0.85)], IRON, 12),
        g.rod((0, 0, 0.8), (0, 0, height), (0.075, 0.055), IRON, 10),
        g.rod((0, -0.62, height - 0.1), (0, 0.62, height - 0.1), (0.03, 0.03), IRON, 8),
        g.lathe([(0.0, height - 0.02), (0.09, height), (0.05, height + 0.1), (0.0, height + 0.22)], IRON, 10),
    ]
    for y in (-0.62, 0.62):
        solids.append(
            g.transformed(g.lathe([(0.0, -0.2), (0.1, -0.2), (0.19, 0.22), (0.0, 0.22)], glass, 8), (0, y, height))
        )
        solids.append(
            g.transformed(g.lathe([(0.22, 0.2), (0.25, 0.23), (0.05, 0.42), (0.0, 0.5)], IRON, 8), (0, y, height))
        )
        solids.append(g.rod((0, y, height - 0.3), (0, y, height - 0.18), (0.03, 0.1), IRON, 8))
    for z in (height - 0.6, height - 2.12):
        solids.append(g.rod((0, 0, z), (0.84, 0, z), (0.02, 0.02), IRON, 6))
    solids.append(g.box((0.1, -0.012, height - 2.1), (0.8, 0.012, height - 0.62), cloth))
    solids.append(
        g.box((0.1, -0.014, height - 1.78), (0.8, 0.014, height - 1.6), materials.plain("banner-band", (206, 200, 184)))
    )
    return g.assemble(solids)


@fixture
def bin() -> Mesh:
    """Return a litter bin of two compartments under one roof, with its openings at the front."""
    shell, dark = materials.plain("bin-shell", (92, 98, 94), 0.15), materials.SHADOW
    solids = [
        g.box((-0.30, -0.58, 0.08), (0.30, 0.58, 1.02), shell),
        g.box((-0.26, -0.54, -SINK), (0.26, 0.54, 0.08), IRON),
        g.box((-0.33, -0.62, 1.02), (0.33, 0.62, 1.07), IRON),
        g.profile([(-0.34, 1.36), (0.40, 1.30), (0.40, 1.35), (-0.34, 1.44)], -0.64, 0.64, IRON),
    ]
    solids += [g.box((-0.28, y - 0.04, 1.05), (-0.20, y + 0.04, 1.38), IRON) for y in (-0.54, 0.54)]
    solids += [g.box((0.24, y - 0.03, 1.05), (0.30, y + 0.03, 1.33), IRON) for y in (-0.54, 0.54)]
    for y in (-0.29, 0.29):
        solids.append(g.box((0.29, y - 0.25, 0.14), (0.325, y + 0.25, 0.98), SLATS, 0.6))
        solids.append(g.box((0.29, y - 0.19, 0.74), (0.335, y + 0.19, 0.90), dark))
    return g.assemble(solids)


def _bicycle(at: tuple[float, float], lean: float) -> list[MeshPart]:
    """Return a bicycle made of thin rods, placed at (x, y) `at` and turned by the yaw `lean` (rad)."""
    tyre, frame = materials.RUBBER, materials.plain("bicycle", (64, 68, 74), 0.4)
    turn = np.linspace(0, 2 * np.pi, 13)
    solids = []
    for x in (-0.52, 0.52):
        rim = [(x + 0.33 * np.cos(a), 0.0, 0.35 + 0.33 * np.sin(a)) for a in turn]
        solids += [g.rod(p, q, (0.022, 0.022), tyre, 3) for p, q in itertools.pairwise(rim)]
        solids += [
            g.rod((x, 0, 0.35), (x + 0.33 * np.cos(a), 0, 0.35 + 0.33 * np.sin(a)), (0.006, 0.006), materials.STEEL, 3)
            for a in turn[:-1:2]
        ]
    tubes = [
        ((-0.52, 0.35), (-0.10, 0.33)), ((-0.52, 0.35), (-0.22, 0.82)), ((-0.10, 0.33), (-0.24, 0.92)),
        ((-0.10, 0.33), (0.34, 0.76)), ((-0.22, 0.80), (0.34, 0.82)), ((0.52, 0.35), (0.32, 0.98)),
    ]  # fmt: skip
    solids += [g.rod((a, 0, b), (c, 0, d), (0.022, 0.022), frame, 5) for (a, b), (c, d) in tubes]
    solids.append(g.rod((0.30, -0.26, 1.0), (0.30, 0.26, 1.0), (0.018, 0.018), materials.TRIM, 6))
    solids.append(g.ball((-0.27, 0, 0.95), (0.14, 0.07, 0.04), materials.TRIM, 1))
    return [g.transformed(p, (*at, 0.0), lean) for p in solids]


@fixture
def bike_rack() -> Mesh:
    """Return a covered rack: five hoops, three bicycles, a low back wall and a slanted roof."""
    back = materials.plain("rack-screen", (150, 156, 156), 0.3)
    solids = [g.box((-1.0, y - 0.05, -SINK), (-0.9, y + 0.05, 2.05), IRON) for y in (-2.0, 0.0, 2.0)]
    solids += [g.box((0.75, y - 0.05, -SINK), (0.85, y + 0.05, 2.28), IRON) for y in (-2.0, 2.0)]
    solids.append(g.profile([(-1.2, 2.02), (1.15, 2.30), (1.15, 2.38), (-1.2, 2.10)], -2.25, 2.25, back))
    solids.append(g.box((-0.97, -1.95, 0.25), (-0.94, 1.95, 1.45), back))
    for y in (-1.5, -0.75, 0.0, 0.75, 1.5):
        hoop = [(0.55 * np.cos(a), y, 0.35 + 0.45 * np.sin(a)) for a in np.linspace(0, np.pi, 9)]
        hoop = [(0.55, y, -SINK), *hoop, (-0.55, y, -SINK)]
        solids += [g.rod(p, q, (0.025, 0.025), materials.STEEL, 6) for p, q in itertools.pairwise(hoop)]
    for y, lean in ((-1.35, 0.04), (-0.58, -0.05), (0.92, 0.03)):
        solids += _bicycle((0.0, y), lean)
    return g.assemble(solids)


@fixture
def bollard() -> Mesh:
    """Return a cast bollard with two bands."""
    outline = [(0.0, -SINK), (0.13, -SINK), (0.13, 0.06), (0.10, 0.1), (0.10, 0.86), (0.125, 0.88), (0.125, 0.95)]
    steel = materials.plain("bollard-band", (196, 198, 198), 0.4)
    return g.assemble(
        [
            g.lathe([*outline, (0.09, 1.02), (0.0, 1.05)], IRON, 12),
            *[g.rod((0, 0, z), (0, 0, z + 0.05), (0.11, 0.11), steel, 12) for z in (0.62, 0.74)],
        ]
    )


@fixture
def planter() -> Mesh:
    """Return a wide cast tub with a clipped shrub."""
    soil = materials.plain("soil", (70, 54, 42))
    outline = [(0.0, -SINK), (0.66, -SINK), (0.72, 0.1), (0.92, 0.66), (0.98, 0.68), (0.98, 0.78), (0.88, 0.78)]
    solids = [g.lathe([*outline, (0.88, 0.7)], CAST, 18), g.lathe([(0.88, 0.71), (0.0, 0.73)], soil, 18)]
    turns = 2.0 * np.pi * np.arange(7) / 7
    lobes = [plants.Lobe(np.array((0.0, 0.0, 1.12)), np.array((0.68, 0.68, 0.52)))]
    lobes += [plants.Lobe(np.array((0.68 * np.cos(a), 0.68 * np.sin(a), 0.86)), np.full(3, 0.24)) for a in turns]
    return g.assemble([*solids, *plants.shrubbery(lobes, "box", 0.34, 1.5, np.random.default_rng(5))])


@fixture
def notice_board() -> Mesh:
    """Return a roofed board with sheets of paper on both sides."""
    wood = surface("boards", (0.72, 0.68, 0.64))
    solids = [g.box((-0.07, y - 0.07, -SINK), (0.07, y + 0.07, 2.2), wood, 1.2) for y in (-1.18, 1.18)]
    solids.append(g.box((-0.06, -1.12, 0.72), (0.06, 1.12, 2.05), wood, 1.2))
    roof = [(-0.42, 2.16), (0.0, 2.40), (0.42, 2.16), (0.42, 2.21), (0.0, 2.46), (-0.42, 2.21)]
    for ring in ((roof[0], roof[1], roof[4], roof[5]), (roof[1], roof[2], roof[3], roof[4])):
        solids.append(g.profile(ring, -1.4, 1.4, materials.plain("board-roof", (84, 88, 90))))
    for seed, turn in ((1, 0.0), (2, np.pi)):
        sheet = g.panel(0.07, (-1.02, 1.02), (0.84, 1.94), materials.notices(seed))
        solids.append(g.transformed(sheet, yaw=turn))
        frame = [
            ((-1.08, 0.78), (1.08, 0.84)),
            ((-1.08, 1.94), (1.08, 2.0)),
            ((-1.08, 0.84), (-1.02, 1.94)),
            ((1.02, 0.84), (1.08, 1.94)),
        ]
        solids += [g.transformed(g.box((0.05, a, b), (0.1, c, d), IRON), yaw=turn) for (a, b), (c, d) in frame]
    return g.assemble(solids)


def _ring(radius: float, sides: int) -> Array:
    turn = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


@fixture
def picnic_table() -> Mesh:
    """Return a table with two benches under a parasol."""
    cloth = materials.plain("parasol", (222, 214, 194))
    solids = [g.box((-0.42, -0.95, 0.70), (0.42, 0.95, 0.76), SLATS, 1.2)]
    for x in (-0.82, 0.82):
        solids.append(g.box((x - 0.15, -0.95, 0.42), (x + 0.15, 0.95, 0.47), SLATS, 1.2))
    for y in (-0.65, 0.65):
        solids.append(g.box((-0.92, y - 0.04, 0.34), (0.92, y + 0.04, 0.42), IRON))
        for x in (-0.34, 0.34):
            solids.append(g.rod((x * 2.2, y, -SINK), (x * 0.8, y, 0.70), (0.045, 0.045), IRON, 6))
    solids.append(g.rod((0, 0, -SINK), (0, 0, 2.62), (0.03, 0.025), IRON, 8))
    solids.append(g.lathe([(0.0, 0.0), (0.32, 0.0), (0.32, 0.09), (0.0, 0.14)], CAST, 12))
    low = np.column_stack([_ring(1.55, 8), np.full(8, 2.08)])
    high = np.column_stack([_ring(0.05, 8), np.full(8, 2.62)])
    top = g.soup([[low[k], low[(k + 1) % 8], high[(k + 1) % 8]] for k in range(8)], cloth, 0.0)
    under = g.soup([[low[(k + 1) % 8], low[k], high[k] - (0, 0, 0.05)] for k in range(8)], cloth, 0.0)
    hem, rim = low - (0, 0, 0.16), np.array((0.99, 0.99, 1.0))  # `rim` moves the inner side of the hem inwards by 1 %
    flap = np.array(
        [t for k in range(8) for m in [(k + 1) % 8] for t in ([hem[k], hem[m], low[m]], [hem[k], low[m], low[k]])]
    )
    return g.assemble([*solids, top, under, g.soup(flap, cloth, 0.0), g.soup(flap[:, ::-1] * rim, cloth, 0.0)])


def _stone(tint: float = 1.0) -> Material:
    return surface("ashlar", (0.74 * tint, 0.71 * tint, 0.66 * tint))


def _basin(radius: float, height: float) -> list[MeshPart]:
    """Return a round basin with a broad rim and water in it."""
    outline = [(radius - 0.1, -SINK), (radius, 0.08), (radius - 0.06, height - 0.12), (radius + 0.06, height - 0.1)]
    outline += [(radius + 0.06, height), (radius - 0.42, height), (radius - 0.42, height - 0.25)]
    water = [(radius - 0.4, height - 0.14), (0.0, height - 0.14)]
    return [g.lathe(outline, _stone(), 32, 1.2), g.lathe(water, WATER, 32)]


def _bowl(radius: float, foot: float, rim: float) -> list[MeshPart]:
    """Return a bowl of water on a stem; `foot` and `rim` are the heights (m) of its lower and upper end."""
    deep = 0.32 * radius
    outline = [(0.0, foot), (0.26, foot), (0.17, foot + 0.2), (0.15, rim - deep - 0.12), (0.3, rim - deep)]
    outline += [(0.7 * radius, rim - 0.45 * deep), (radius, rim), (radius - 0.07, rim), (radius - 0.1, rim - 0.06)]
    return [
        g.lathe(outline, _stone(0.95), 24, 1.2),
        g.lathe([(radius - 0.09, rim - 0.05), (0.0, rim - 0.05)], WATER, 24),
    ]


def _curtain(radius: float, top: float, bottom: float, seed: int) -> list[MeshPart]:
    """Return water that falls from a rim in separate strands."""
    rng, solids = np.random.default_rng(seed), []
    for a in 2 * np.pi * (np.arange(20) + rng.uniform(-0.3, 0.3, 20)) / 20:
        way = np.array((np.cos(a), np.sin(a), 0.0))
        bend = [radius * way + (0, 0, top), (radius + 0.13) * way + (0, 0, (top * 2 + bottom) / 3)]
        bend.append((radius + 0.2) * way + np.array((0, 0, bottom)))
        thick = rng.uniform(0.012, 0.024)
        for (p, q), (r0, r1) in zip(itertools.pairwise(bend), ((1.0, 0.8), (0.8, 0.4)), strict=True):
            solids.append(g.rod(p, q, (thick * r0, thick * r1), SPRAY, 3))
    return solids


def _jet(foot: float) -> list[MeshPart]:
    """Return a thin column of water that falls apart into six strands."""
    top = np.array((0.0, 0.0, foot + 0.78))
    solids = [g.lathe([(0.025, foot), (0.032, foot + 0.3), (0.04, foot + 0.6), (0.0, foot + 0.8)], SPRAY, 8)]
    for a in 2 * np.pi * np.arange(6) / 6:
        way = np.array((np.cos(a), np.sin(a), 0.0))
        bend = [top, top + 0.11 * way - (0.0, 0.0, 0.04), top + 0.2 * way - np.array((0.0, 0.0, 0.3))]
        bend.append(top + 0.25 * way - np.array((0.0, 0.0, 0.6)))
        widths = ((0.022, 0.018), (0.018, 0.012), (0.012, 0.006))
        solids += [g.rod(p, q, r, SPRAY, 3) for (p, q), r in zip(itertools.pairwise(bend), widths, strict=True)]
    return solids


@fixture
def fountain(tiers: int = 1) -> Mesh:
    """Return a fountain: a basin with one bowl, or a wider basin with `tiers` bowls above one another."""
    radius, height = (2.5, 0.55) if tiers == 1 else (3.2, 0.62)
    solids = _basin(radius, height)
    foot, wide = height - 0.2, 1.0 if tiers == 1 else 1.7
    for k in range(tiers):
        rim = foot + (1.25 if tiers == 1 else (1.45, 1.1, 0.8)[k])
        solids += _bowl(wide, foot, rim)
        below = height - 0.14 if k == 0 else foot
        solids += _curtain(wide, rim, below, k)
        foot, wide = rim - 0.05, wide * 0.58
    return g.assemble([*solids, *_jet(foot)])


@fixture
def statue() -> Mesh:
    """Return a robed bronze figure on a stepped plinth, with a book in one hand and the other hand raised."""
    stone = _stone()
    solids = [
        g.box((-1.05, -1.05, -SINK), (1.05, 1.05, 0.22), stone, 1.6),
        g.box((-0.80, -0.80, 0.22), (0.80, 0.80, 0.42), stone, 1.6),
        g.box((-0.60, -0.60, 0.42), (0.60, 0.60, 1.72), stone, 1.6),
        g.box((-0.72, -0.72, 1.72), (0.72, 0.72, 1.90), stone, 1.6),
        g.box((0.60, -0.38, 0.85), (0.63, 0.38, 1.35), BRONZE),
        g.box((-0.45, -0.45, 1.90), (0.45, 0.45, 1.98), BRONZE),
    ]
    robe = [
        (0.0, 1.98),
        (0.44, 1.98),
        (0.40, 2.25),
        (0.30, 2.75),
        (0.26, 3.15),
        (0.30, 3.35),
        (0.33, 3.55),
        (0.16, 3.70),
    ]
    folds = g.lathe([*robe, (0.10, 3.78), (0.0, 3.80)], BRONZE, 20)
    solids.append(g.soup(g.roughened(folds, 0.035, 3, 0.32).corners * np.array((0.82, 1.12, 1.0)), BRONZE, 50.0))
    solids += [
        g.rod((0, 0, 3.7), (0.02, 0, 3.88), (0.09, 0.08), BRONZE, 8),
        g.ball((0.03, 0, 4.02), (0.15, 0.13, 0.19), BRONZE, 2),
        g.ball((-0.04, 0, 4.10), (0.16, 0.15, 0.16), BRONZE, 1),
        # the raised arm, the arm that holds the book, the book
        g.rod((0.0, -0.32, 3.50), (0.22, -0.60, 3.72), (0.13, 0.10), BRONZE, 8),
        g.rod((0.22, -0.60, 3.72), (0.42, -0.66, 4.18), (0.10, 0.06), BRONZE, 8),
        g.ball((0.45, -0.67, 4.25), (0.07, 0.06, 0.10), BRONZE, 1),
        g.rod((0.0, 0.34, 3.50), (0.05, 0.46, 3.08), (0.13, 0.11), BRONZE, 8),
        g.rod((0.05, 0.46, 3.08), (0.40, 0.34, 3.10), (0.11, 0.07), BRONZE, 8),
        g.box((0.28, 0.14, 3.08), (0.52, 0.50, 3.20), BRONZE),
    ]
    return g.assemble(solids)


def _hip(half: tuple[float, float], eave: float, top: float, material: Material) -> MeshPart:
    """Return a four-sided roof over a rectangle with the half extents `half` (m)."""
    a, b = half
    low = [(-a, -b, eave), (a, -b, eave), (a, b, eave), (-a, b, eave)]
    return g.hull(low, [(x * 0.16, y * 0.16, top) for x, y, _ in low], material, 1.6)


@fixture
def kiosk() -> Mesh:
    """Return a coffee booth with a counter and an awning at the front, a hipped roof and a name board."""
    wall, roof = materials.plain("kiosk-wall", (108, 116, 112), 0.1), materials.plain("kiosk-roof", (70, 74, 78), 0.2)
    trim, glass = materials.WHITE_WOOD, materials.WINDOW
    solids = [
        g.box((-1.25, -1.55, -SINK), (1.25, 1.55, 0.14), CAST),
        g.box((-1.15, -1.45, 0.14), (1.15, 1.45, 2.55), wall),
        _hip((1.55, 1.85), 2.55, 3.35, roof),
        g.lathe([(0.0, 3.3), (0.16, 3.32), (0.16, 3.6), (0.22, 3.62), (0.0, 3.8)], roof, 8),
        g.box((1.15, -1.3, 0.98), (1.55, 1.3, 1.05), SLATS, 1.2),
        g.panel(1.17, (-1.15, 1.15), (1.08, 2.0), glass),
        g.box((1.14, -1.22, 2.0), (1.22, 1.22, 2.08), trim),
        g.box((1.14, -0.03, 1.05), (1.2, 0.03, 2.0), trim),
    ]
    solids += [g.box((1.13, s - 0.05, 0.14), (1.2, s + 0.05, 2.55), trim) for s in (-1.42, -1.2, 1.2, 1.42)]
    for k in range(10):  # the striped awning
        y0, y1 = -1.5 + 0.3 * k, -1.2 + 0.3 * k
        cloth = trim if k % 2 else materials.plain("awning", (92, 84, 78))
        solids.append(g.profile([(1.15, 2.42), (1.15, 2.36), (2.05, 1.98), (2.05, 2.04)], y0, y1, cloth))
        solids.append(g.box((2.03, y0, 1.84), (2.06, y1, 2.04), cloth))
    for side in (-1, 1):  # a window on either side
        turn = side * np.pi / 2
        solids.append(g.transformed(g.panel(1.46, (-0.75, 0.75), (1.1, 2.0), glass), yaw=turn))
        solids += [g.transformed(g.box((1.44, -0.82, z), (1.5, 0.82, z + 0.08), trim), yaw=turn) for z in (1.02, 2.0)]
    sign = materials.lettered("COFFEE", (238, 232, 214), (56, 50, 46))
    solids.append(g.box((1.52, -0.95, 2.58), (1.58, 0.95, 3.0), IRON))
    solids.append(g.panel(1.6, (-0.92, 0.92), (2.6, 2.98), sign))
    solids.append(g.box((-1.18, -0.5, 0.14), (-1.14, 0.4, 2.2), roof))
    return g.assemble(solids)


@fixture
def vending_machine() -> Mesh:
    """Return a tall machine with shelves behind glass."""
    shell = materials.plain("vending-shell", (72, 78, 88), 0.3)
    front = surface("shelves", specular=0.3)
    return g.assemble(
        [
            g.box((-0.42, -0.60, 0.10), (0.42, 0.60, 2.05), shell),
            g.box((-0.36, -0.54, -SINK), (0.36, 0.54, 0.10), IRON),
            g.panel(0.43, (-0.57, 0.57), (0.2, 2.0), front),
            g.box((0.40, -0.62, 2.0), (0.46, 0.62, 2.07), shell),
            *[g.box((0.40, s - 0.03, 0.12), (0.46, s + 0.03, 2.0), shell) for s in (-0.59, 0.59)],
        ]
    )


@fixture
def clock_tower() -> Mesh:
    """Return a brick tower, 26.8 m high, with a dial on each side and an open belfry."""
    brick, stone, roof = surface("brick"), _stone(), materials.plain("tower-roof", (82, 102, 94), 0.15)
    solids = [
        g.box((-2.4, -2.4, -0.4), (2.4, 2.4, 0.9), stone, 2.4),
        g.box((-2.0, -2.0, 0.9), (2.0, 2.0, 14.2), brick, 0.6),
        g.box((-2.25, -2.25, 14.2), (2.25, 2.25, 14.6), stone, 2.4),
        g.box((-2.0, -2.0, 14.6), (2.0, 2.0, 18.0), stone, 2.4),
        g.box((-2.35, -2.35, 18.0), (2.35, 2.35, 18.4), stone, 2.4),
        g.box((-2.4, -2.4, 21.0), (2.4, 2.4, 21.5), stone, 2.4),
        _hip((2.6, 2.6), 21.5, 25.5, roof),
        g.rod((0, 0, 25.3), (0, 0, 26.8), (0.06, 0.02), IRON, 6),
        g.lathe([(0.0, 18.9), (0.75, 18.9), (0.62, 19.4), (0.4, 20.0), (0.0, 20.2)], BRONZE, 16),
    ]
    for x in (-1.7, 1.7):
        solids += [g.box((x - 0.4, y - 0.4, 18.4), (x + 0.4, y + 0.4, 21.0), stone, 2.4) for y in (-1.7, 1.7)]
    for x in (-1.95, 1.95):
        solids += [g.box((x - 0.28, y - 0.28, 0.9), (x + 0.28, y + 0.28, 14.2), brick, 0.6) for y in (-1.95, 1.95)]
    face = surface("dial")
    for k in range(4):
        turn = k * np.pi / 2
        dial = g.panel(2.04, (-1.5, 1.5), (14.8, 17.8), face)
        solids.append(g.transformed(dial, yaw=turn))
        for low in (3.4, 7.0, 10.6):
            slit = g.box((1.98, -0.32, low), (2.03, 0.32, low + 1.7), materials.WINDOW)
            solids += [g.transformed(slit, yaw=turn)]
            solids.append(g.transformed(g.box((1.98, -0.45, low - 0.16), (2.12, 0.45, low), stone), yaw=turn))
            solids.append(g.transformed(g.box((1.98, -0.45, low + 1.7), (2.12, 0.45, low + 1.95), stone), yaw=turn))
    solids.append(g.box((2.0, -0.75, 0.0), (2.44, 0.75, 2.5), stone))
    solids.append(g.panel(2.46, (-0.6, 0.6), (0.1, 2.3), surface("doors")))
    return g.assemble(solids)
