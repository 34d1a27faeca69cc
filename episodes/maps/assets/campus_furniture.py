"""What people sit on, lean a bicycle on and throw things into: the small fixtures of the campus.

All of one kind look the same. Each faces forward and stands with its origin on the ground under its middle.
"""

import itertools
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import campus_textures as textures
from episodes.maps.assets import materials
from episodes.maps.assets.materials import linear, surface
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Mesh

IRON = materials.plain("campus-iron", (48, 52, 54), 0.3)
CAST = materials.plain("cast-concrete", (172, 168, 160))
SLATS = surface("boards", (1.15, 1.08, 1.0), 0.05)
SINK = 0.06  # m below the ground, so that no foot hangs over a gentle slope


@cache
def bench() -> Mesh:
    """Return a long bench: timber seat and back on two cast blocks."""
    parts = [g.box((-0.24, y - 0.17, -SINK), (0.28, y + 0.17, 0.40), CAST) for y in (-0.95, 0.95)]
    parts += [g.box((x, -1.3, 0.40), (x + 0.155, 1.3, 0.46), SLATS, 1.2) for x in (-0.20, -0.03, 0.14)]
    for low, lean in ((0.50, 0.0), (0.66, 0.035), (0.82, 0.07)):
        x = -0.22 - lean
        parts.append(g.box((x - 0.025, -1.3, low), (x + 0.025, 1.3, low + 0.135), SLATS, 1.2))
    for y in (-0.95, 0.0, 0.95):
        ring = [(-0.24, 0.30), (-0.29, 0.30), (-0.36, 0.97), (-0.31, 0.97)]
        parts.append(g.profile(ring, y - 0.035, y + 0.035, IRON))
    for y in (-1.22, 1.22):
        parts.append(g.box((-0.26, y - 0.03, 0.64), (0.26, y + 0.03, 0.68), IRON))
        parts.append(g.box((0.20, y - 0.03, 0.40), (0.25, y + 0.03, 0.64), IRON))
    return g.assemble(parts)


@cache
def lamp(height: float = 4.6) -> Mesh:
    """Return a lamp post with a lantern on either side and a plain banner forward."""
    glass = materials.plain("lantern", (240, 236, 216), 0.4, 0.25)
    cloth = materials.plain("banner", (62, 70, 92))
    parts = [
        g.lathe([(0.0, -SINK), (0.24, -SINK), (0.24, 0.12), (0.15, 0.2), (0.12, 0.75), (0.075, 0.85)], IRON, 12),
        g.rod((0, 0, 0.8), (0, 0, height), (0.075, 0.055), IRON, 10),
        g.rod((0, -0.62, height - 0.1), (0, 0.62, height - 0.1), (0.03, 0.03), IRON, 8),
        g.lathe([(0.0, height - 0.02), (0.09, height), (0.05, height + 0.1), (0.0, height + 0.22)], IRON, 10),
    ]
    for y in (-0.62, 0.62):
        parts.append(g.placed(g.lathe([(0.0, -0.2), (0.1, -0.2), (0.19, 0.22), (0.0, 0.22)], glass, 8), (0, y, height)))
        parts.append(g.placed(g.lathe([(0.22, 0.2), (0.25, 0.23), (0.05, 0.42), (0.0, 0.5)], IRON, 8), (0, y, height)))
        parts.append(g.rod((0, y, height - 0.3), (0, y, height - 0.18), (0.03, 0.1), IRON, 8))
    for z in (height - 0.6, height - 2.12):
        parts.append(g.rod((0, 0, z), (0.84, 0, z), (0.02, 0.02), IRON, 6))
    parts.append(g.box((0.1, -0.012, height - 2.1), (0.8, 0.012, height - 0.62), cloth))
    parts.append(
        g.box((0.1, -0.014, height - 1.78), (0.8, 0.014, height - 1.6), materials.plain("banner-band", (206, 200, 184)))
    )
    return g.assemble(parts)


@cache
def bin() -> Mesh:
    """Return a litter bin of two compartments under one roof, its mouths forward."""
    shell, dark = materials.plain("bin-shell", (92, 98, 94), 0.15), materials.SHADOW
    parts = [
        g.box((-0.30, -0.58, 0.08), (0.30, 0.58, 1.02), shell),
        g.box((-0.26, -0.54, -SINK), (0.26, 0.54, 0.08), IRON),
        g.box((-0.33, -0.62, 1.02), (0.33, 0.62, 1.07), IRON),
        g.profile([(-0.34, 1.36), (0.40, 1.30), (0.40, 1.35), (-0.34, 1.44)], -0.64, 0.64, IRON),
    ]
    parts += [g.box((-0.28, y - 0.04, 1.05), (-0.20, y + 0.04, 1.38), IRON) for y in (-0.54, 0.54)]
    parts += [g.box((0.24, y - 0.03, 1.05), (0.30, y + 0.03, 1.33), IRON) for y in (-0.54, 0.54)]
    for y in (-0.29, 0.29):
        parts.append(g.box((0.29, y - 0.25, 0.14), (0.325, y + 0.25, 0.98), SLATS, 0.6))
        parts.append(g.box((0.29, y - 0.19, 0.74), (0.335, y + 0.19, 0.90), dark))
    return g.assemble(parts)


def _bicycle(at: tuple[float, float], lean: float) -> list[MeshPart]:
    """Return a bicycle whose front wheel points forward, seen as thin rods."""
    tyre, frame = materials.RUBBER, materials.plain("bicycle", (64, 68, 74), 0.4)
    turn = np.linspace(0, 2 * np.pi, 13)
    parts = []
    for x in (-0.52, 0.52):
        rim = [(x + 0.33 * np.cos(a), 0.0, 0.35 + 0.33 * np.sin(a)) for a in turn]
        parts += [g.rod(p, q, (0.022, 0.022), tyre, 3) for p, q in itertools.pairwise(rim)]
        parts += [
            g.rod((x, 0, 0.35), (x + 0.33 * np.cos(a), 0, 0.35 + 0.33 * np.sin(a)), (0.006, 0.006), materials.STEEL, 3)
            for a in turn[:-1:2]
        ]
    tubes = [
        ((-0.52, 0.35), (-0.10, 0.33)), ((-0.52, 0.35), (-0.22, 0.82)), ((-0.10, 0.33), (-0.24, 0.92)),
        ((-0.10, 0.33), (0.34, 0.76)), ((-0.22, 0.80), (0.34, 0.82)), ((0.52, 0.35), (0.32, 0.98)),
    ]  # fmt: skip
    parts += [g.rod((a, 0, b), (c, 0, d), (0.022, 0.022), frame, 5) for (a, b), (c, d) in tubes]
    parts.append(g.rod((0.30, -0.26, 1.0), (0.30, 0.26, 1.0), (0.018, 0.018), materials.TRIM, 6))
    parts.append(g.ball((-0.27, 0, 0.95), (0.14, 0.07, 0.04), materials.TRIM, 1))
    return [g.placed(p, (*at, 0.0), lean) for p in parts]


@cache
def bike_rack() -> Mesh:
    """Return a covered rack: five hoops, three bicycles, a low back wall and a slanted roof."""
    back = materials.plain("rack-screen", (150, 156, 156), 0.3)
    parts = [g.box((-1.0, y - 0.05, -SINK), (-0.9, y + 0.05, 2.05), IRON) for y in (-2.0, 0.0, 2.0)]
    parts += [g.box((0.75, y - 0.05, -SINK), (0.85, y + 0.05, 2.28), IRON) for y in (-2.0, 2.0)]
    parts.append(g.profile([(-1.2, 2.02), (1.15, 2.30), (1.15, 2.38), (-1.2, 2.10)], -2.25, 2.25, back))
    parts.append(g.box((-0.97, -1.95, 0.25), (-0.94, 1.95, 1.45), back))
    for y in (-1.5, -0.75, 0.0, 0.75, 1.5):
        hoop = [(0.55 * np.cos(a), y, 0.35 + 0.45 * np.sin(a)) for a in np.linspace(0, np.pi, 9)]
        hoop = [(0.55, y, -SINK), *hoop, (-0.55, y, -SINK)]
        parts += [g.rod(p, q, (0.025, 0.025), materials.STEEL, 6) for p, q in itertools.pairwise(hoop)]
    for y, lean in ((-1.35, 0.04), (-0.58, -0.05), (0.92, 0.03)):
        parts += _bicycle((0.0, y), lean)
    return g.assemble(parts)


@cache
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


@cache
def planter() -> Mesh:
    """Return a wide cast tub with a clipped shrub."""
    leaf = surface("foliage", linear((104, 136, 76)))
    soil = materials.plain("soil", (70, 54, 42))
    outline = [(0.0, -SINK), (0.66, -SINK), (0.72, 0.1), (0.92, 0.66), (0.98, 0.68), (0.98, 0.78), (0.88, 0.78)]
    parts = [
        g.lathe([*outline, (0.88, 0.7)], CAST, 18),
        g.lathe([(0.88, 0.71), (0.0, 0.73)], soil, 18),
        g.roughened(g.ball((0, 0, 1.12), (0.68, 0.68, 0.52), leaf, 2), 0.05, 5, 0.4),
    ]
    for k in range(7):
        a = 2 * np.pi * k / 7
        clump = g.ball((0.68 * np.cos(a), 0.68 * np.sin(a), 0.82), (0.24, 0.24, 0.2), leaf, 0)
        parts.append(g.roughened(clump, 0.03, k, 0.2))
    return g.assemble(parts)


@cache
def notice_board() -> Mesh:
    """Return a roofed board with sheets of paper on both sides."""
    wood = surface("boards", (0.72, 0.68, 0.64))
    parts = [g.box((-0.07, y - 0.07, -SINK), (0.07, y + 0.07, 2.2), wood, 1.2) for y in (-1.18, 1.18)]
    parts.append(g.box((-0.06, -1.12, 0.72), (0.06, 1.12, 2.05), wood, 1.2))
    roof = [(-0.42, 2.16), (0.0, 2.40), (0.42, 2.16), (0.42, 2.21), (0.0, 2.46), (-0.42, 2.21)]
    for ring in ((roof[0], roof[1], roof[4], roof[5]), (roof[1], roof[2], roof[3], roof[4])):
        parts.append(g.profile(ring, -1.4, 1.4, materials.plain("board-roof", (84, 88, 90))))
    for seed, turn in ((1, 0.0), (2, np.pi)):
        sheet = g.quad(
            [(0.07, -1.02, 0.84), (0.07, 1.02, 0.84), (0.07, 1.02, 1.94), (0.07, -1.02, 1.94)], textures.board(seed)
        )
        parts.append(g.placed(sheet, yaw=turn))
        frame = [
            ((-1.08, 0.78), (1.08, 0.84)),
            ((-1.08, 1.94), (1.08, 2.0)),
            ((-1.08, 0.84), (-1.02, 1.94)),
            ((1.02, 0.84), (1.08, 1.94)),
        ]
        parts += [g.placed(g.box((0.05, a, b), (0.1, c, d), IRON), yaw=turn) for (a, b), (c, d) in frame]
    return g.assemble(parts)


def _ring(radius: float, sides: int) -> Array:
    turn = 2 * np.pi * np.arange(sides) / sides
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])


@cache
def picnic_table() -> Mesh:
    """Return a table with two benches under a parasol."""
    cloth = materials.plain("parasol", (222, 214, 194))
    parts = [g.box((-0.42, -0.95, 0.70), (0.42, 0.95, 0.76), SLATS, 1.2)]
    for x in (-0.82, 0.82):
        parts.append(g.box((x - 0.15, -0.95, 0.42), (x + 0.15, 0.95, 0.47), SLATS, 1.2))
    for y in (-0.65, 0.65):
        parts.append(g.box((-0.92, y - 0.04, 0.34), (0.92, y + 0.04, 0.42), IRON))
        for x in (-0.34, 0.34):
            parts.append(g.rod((x * 2.2, y, -SINK), (x * 0.8, y, 0.70), (0.045, 0.045), IRON, 6))
    parts.append(g.rod((0, 0, -SINK), (0, 0, 2.62), (0.03, 0.025), IRON, 8))
    parts.append(g.lathe([(0.0, 0.0), (0.32, 0.0), (0.32, 0.09), (0.0, 0.14)], CAST, 12))
    low = np.column_stack([_ring(1.55, 8), np.full(8, 2.08)])
    high = np.column_stack([_ring(0.05, 8), np.full(8, 2.62)])
    top = g.soup([[low[k], low[(k + 1) % 8], high[(k + 1) % 8]] for k in range(8)], cloth, 0.0)
    under = g.soup([[low[(k + 1) % 8], low[k], high[k] - (0, 0, 0.05)] for k in range(8)], cloth, 0.0)
    hem, rim = low - (0, 0, 0.16), np.array((0.99, 0.99, 1.0))  # its inner side a centimetre further in
    flap = np.array(
        [t for k in range(8) for m in [(k + 1) % 8] for t in ([hem[k], hem[m], low[m]], [hem[k], low[m], low[k]])]
    )
    return g.assemble([*parts, top, under, g.soup(flap, cloth, 0.0), g.soup(flap[:, ::-1] * rim, cloth, 0.0)])
