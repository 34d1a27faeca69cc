"""The larger fixtures of the campus: fountains, statues, kiosks, vending machines and the clock tower."""

import itertools
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import campus_textures as textures
from episodes.maps.assets import materials
from episodes.maps.assets.campus_furniture import CAST, IRON, SINK, SLATS
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Material, Mesh

WATER = materials.plain("water", (84, 124, 138), 0.85)
SPRAY = materials.plain("spray", (206, 220, 226), 0.3, 0.06)
BRONZE = materials.plain("bronze", (86, 92, 78), 0.35)


def _stone(tint: float = 1.0) -> Material:
    return textures.material("ashlar", (0.74 * tint, 0.71 * tint, 0.66 * tint))


def _basin(radius: float, height: float) -> list[MeshPart]:
    """Return a round basin with a broad rim and water in it."""
    outline = [(radius - 0.1, -SINK), (radius, 0.08), (radius - 0.06, height - 0.12), (radius + 0.06, height - 0.1)]
    outline += [(radius + 0.06, height), (radius - 0.42, height), (radius - 0.42, height - 0.25)]
    water = [(radius - 0.4, height - 0.14), (0.0, height - 0.14)]
    return [g.lathe(outline, _stone(), 32, 1.2), g.lathe(water, WATER, 32)]


def _bowl(radius: float, foot: float, rim: float) -> list[MeshPart]:
    """Return a bowl on its stem, full of water, from the height of its foot to that of its rim."""
    deep = 0.32 * radius
    outline = [(0.0, foot), (0.26, foot), (0.17, foot + 0.2), (0.15, rim - deep - 0.12), (0.3, rim - deep)]
    outline += [(0.7 * radius, rim - 0.45 * deep), (radius, rim), (radius - 0.07, rim), (radius - 0.1, rim - 0.06)]
    return [
        g.lathe(outline, _stone(0.95), 24, 1.2),
        g.lathe([(radius - 0.09, rim - 0.05), (0.0, rim - 0.05)], WATER, 24),
    ]


def _curtain(radius: float, top: float, bottom: float, seed: int) -> list[MeshPart]:
    """Return water that falls from a rim in separate strands."""
    rng, parts = np.random.default_rng(seed), []
    for a in 2 * np.pi * (np.arange(14) + rng.uniform(-0.2, 0.2, 14)) / 14:
        way = np.array((np.cos(a), np.sin(a), 0.0))
        bend = [radius * way + (0, 0, top), (radius + 0.13) * way + (0, 0, (top * 2 + bottom) / 3)]
        bend.append((radius + 0.2) * way + np.array((0, 0, bottom)))
        parts += [g.rod(p, q, (0.035, 0.035), SPRAY, 4) for p, q in itertools.pairwise(bend)]
    return parts


@cache
def fountain(tiers: int = 1) -> Mesh:
    """Return a fountain: a basin with one bowl, or a wider one with `tiers` bowls above each other."""
    radius, height = (2.5, 0.55) if tiers == 1 else (3.2, 0.62)
    parts = _basin(radius, height)
    foot, wide = height - 0.2, 1.0 if tiers == 1 else 1.7
    for k in range(tiers):
        rim = foot + (1.25 if tiers == 1 else (1.45, 1.1, 0.8)[k])
        parts += _bowl(wide, foot, rim)
        below = height - 0.14 if k == 0 else foot
        parts += _curtain(wide, rim, below, k)
        foot, wide = rim - 0.05, wide * 0.58
    jet = [
        (0.05, foot),
        (0.04, foot + 0.35),
        (0.10, foot + 0.6),
        (0.16, foot + 0.5),
        (0.10, foot + 0.72),
        (0.0, foot + 0.8),
    ]
    parts.append(g.lathe(jet, SPRAY, 10))
    return g.assemble(parts)


@cache
def statue() -> Mesh:
    """Return a robed figure in bronze, a book in one hand and the other raised, on a stepped plinth."""
    stone = _stone()
    parts = [
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
    parts.append(g.soup(g.roughened(folds, 0.035, 3, 0.32).corners * np.array((0.82, 1.12, 1.0)), BRONZE, 50.0))
    parts += [
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
    return g.assemble(parts)


def _hip(half: tuple[float, float], eave: float, top: float, material: Material) -> MeshPart:
    """Return a four-sided roof over a rectangle of half extents."""
    a, b = half
    low = [(-a, -b, eave), (a, -b, eave), (a, b, eave), (-a, b, eave)]
    return g.hull(low, [(x * 0.16, y * 0.16, top) for x, y, _ in low], material, 1.6)


@cache
def kiosk() -> Mesh:
    """Return a booth that sells coffee: counter and awning forward, a hipped roof, a board with its name."""
    wall, roof = materials.plain("kiosk-wall", (108, 116, 112), 0.1), materials.plain("kiosk-roof", (70, 74, 78), 0.2)
    trim, glass = materials.WHITE_WOOD, materials.WINDOW
    parts = [
        g.box((-1.25, -1.55, -SINK), (1.25, 1.55, 0.14), CAST),
        g.box((-1.15, -1.45, 0.14), (1.15, 1.45, 2.55), wall),
        _hip((1.55, 1.85), 2.55, 3.35, roof),
        g.lathe([(0.0, 3.3), (0.16, 3.32), (0.16, 3.6), (0.22, 3.62), (0.0, 3.8)], roof, 8),
        g.box((1.15, -1.3, 0.98), (1.55, 1.3, 1.05), SLATS, 1.2),
        g.quad([(1.17, -1.15, 1.08), (1.17, 1.15, 1.08), (1.17, 1.15, 2.0), (1.17, -1.15, 2.0)], glass),
        g.box((1.14, -1.22, 2.0), (1.22, 1.22, 2.08), trim),
        g.box((1.14, -0.03, 1.05), (1.2, 0.03, 2.0), trim),
    ]
    parts += [g.box((1.13, s - 0.05, 0.14), (1.2, s + 0.05, 2.55), trim) for s in (-1.42, -1.2, 1.2, 1.42)]
    for k in range(10):  # the striped awning
        y0, y1 = -1.5 + 0.3 * k, -1.2 + 0.3 * k
        cloth = trim if k % 2 else materials.plain("awning", (92, 84, 78))
        parts.append(g.profile([(1.15, 2.42), (1.15, 2.36), (2.05, 1.98), (2.05, 2.04)], y0, y1, cloth))
        parts.append(g.box((2.03, y0, 1.84), (2.06, y1, 2.04), cloth))
    for side in (-1, 1):  # a window on either side
        turn = side * np.pi / 2
        parts.append(
            g.placed(
                g.quad([(1.46, -0.75, 1.1), (1.46, 0.75, 1.1), (1.46, 0.75, 2.0), (1.46, -0.75, 2.0)], glass), yaw=turn
            )
        )
        parts += [g.placed(g.box((1.44, -0.82, z), (1.5, 0.82, z + 0.08), trim), yaw=turn) for z in (1.02, 2.0)]
    sign = textures.lettered("COFFEE", (238, 232, 214), (56, 50, 46))
    parts.append(g.box((1.52, -0.95, 2.58), (1.58, 0.95, 3.0), IRON))
    parts.append(g.quad([(1.6, -0.92, 2.6), (1.6, 0.92, 2.6), (1.6, 0.92, 2.98), (1.6, -0.92, 2.98)], sign))
    parts.append(g.box((-1.18, -0.5, 0.14), (-1.14, 0.4, 2.2), roof))
    return g.assemble(parts)


@cache
def vending_machine() -> Mesh:
    """Return a tall machine with shelves behind glass."""
    shell = materials.plain("vending-shell", (72, 78, 88), 0.3)
    front = textures.material("shelves", specular=0.3)
    return g.assemble(
        [
            g.box((-0.42, -0.60, 0.10), (0.42, 0.60, 2.05), shell),
            g.box((-0.36, -0.54, -SINK), (0.36, 0.54, 0.10), IRON),
            g.quad([(0.43, -0.57, 0.2), (0.43, 0.57, 0.2), (0.43, 0.57, 2.0), (0.43, -0.57, 2.0)], front),
            g.box((0.40, -0.62, 2.0), (0.46, 0.62, 2.07), shell),
            *[g.box((0.40, s - 0.03, 0.12), (0.46, s + 0.03, 2.0), shell) for s in (-0.59, 0.59)],
        ]
    )


def _arch(half: float, spring: float, steps: int = 10) -> Array:
    turn = np.linspace(0.0, np.pi, steps)
    return np.column_stack([half * np.cos(turn), spring + half * np.sin(turn)])


@cache
def clock_tower() -> Mesh:
    """Return a brick tower of 24 m with a dial on each side and an open belfry."""

    brick, stone, roof = surface("brick"), _stone(), materials.plain("tower-roof", (82, 102, 94), 0.15)
    parts = [
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
        parts += [g.box((x - 0.4, y - 0.4, 18.4), (x + 0.4, y + 0.4, 21.0), stone, 2.4) for y in (-1.7, 1.7)]
    for x in (-1.95, 1.95):
        parts += [g.box((x - 0.28, y - 0.28, 0.9), (x + 0.28, y + 0.28, 14.2), brick, 0.6) for y in (-1.95, 1.95)]
    face = textures.material("dial")
    for k in range(4):
        turn = k * np.pi / 2
        dial = g.quad([(2.04, -1.5, 14.8), (2.04, 1.5, 14.8), (2.04, 1.5, 17.8), (2.04, -1.5, 17.8)], face)
        parts.append(g.placed(dial, yaw=turn))
        for low in (3.4, 7.0, 10.6):
            slit = g.box((1.98, -0.32, low), (2.03, 0.32, low + 1.7), materials.WINDOW)
            parts += [g.placed(slit, yaw=turn)]
            parts.append(g.placed(g.box((1.98, -0.45, low - 0.16), (2.12, 0.45, low), stone), yaw=turn))
            parts.append(g.placed(g.box((1.98, -0.45, low + 1.7), (2.12, 0.45, low + 1.95), stone), yaw=turn))
    parts.append(g.box((2.0, -0.75, 0.0), (2.44, 0.75, 2.5), stone))
    parts.append(
        g.quad([(2.46, -0.6, 0.1), (2.46, 0.6, 0.1), (2.46, 0.6, 2.3), (2.46, -0.6, 2.3)], textures.material("doors"))
    )
    return g.assemble(parts)
