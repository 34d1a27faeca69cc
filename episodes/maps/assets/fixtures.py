"""The things of the campus by kind, and the two of them that drive at walking pace."""

import itertools
from collections.abc import Callable
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import campus_furniture, campus_monuments, materials
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Mesh

# kind → its maker: everything of one kind looks the same
MAKERS: dict[str, Callable[[], Mesh]] = {
    "bench": campus_furniture.bench,
    "bike-rack": campus_furniture.bike_rack,
    "bin": campus_furniture.bin,
    "bollard": campus_furniture.bollard,
    "clock-tower": campus_monuments.clock_tower,
    "fountain": campus_monuments.fountain,
    "kiosk": campus_monuments.kiosk,
    "lamp": campus_furniture.lamp,
    "notice-board": campus_furniture.notice_board,
    "picnic-table": campus_furniture.picnic_table,
    "planter": campus_furniture.planter,
    "statue": campus_monuments.statue,
    "vending-machine": campus_monuments.vending_machine,
}


def _wheel(x: float, y: float, radius: float, width: float) -> list[MeshPart]:
    """Return a wheel that touches the ground, its hub outwards."""
    out = np.sign(y) * width / 2
    return [
        g.rod((x, y - out, radius), (x, y + out, radius), (radius, radius), materials.RUBBER, 20),
        g.rod(
            (x, y + out * 0.9, radius), (x, y + out * 1.12, radius), (radius * 0.62, radius * 0.5), materials.RIM, 12
        ),
    ]


@cache
def delivery_robot(paint: str) -> Mesh:
    """Return a delivery pod of 2.4 m on four wheels, hatches on its sides, in a paint. Raises UsageError."""
    shell = materials.paint(paint)
    side = [(-1.15, 0.42), (-1.20, 0.75), (-1.16, 1.35), (-1.02, 1.58), (-0.75, 1.66), (0.55, 1.66), (0.85, 1.56)]
    side += [(1.08, 1.22), (1.19, 0.80), (1.20, 0.55), (1.12, 0.42)]
    rings = []
    for y, k in ((-0.55, 0.93), (-0.49, 0.985), (-0.40, 1.0), (0.40, 1.0), (0.49, 0.985), (0.55, 0.93)):
        rings.append([(x * k, y, 1.03 + (z - 1.03) * k) for x, z in [*side, side[0]]])
    skin = g.grid(np.array(rings)[::-1], shell, 40.0)
    caps = []
    for row, flip in ((rings[0], -1), (rings[-1], 1)):
        loop = np.array(row[:-1])
        caps.append(g.soup(loop[np.array([(0, k, k + 1)[::flip] for k in range(1, len(loop) - 1)])], shell, 0.0))
    parts = [skin, *caps, g.box((-0.95, -0.46, 0.26), (0.95, 0.46, 0.46), materials.TRIM)]
    for x in (-0.72, 0.72):
        for y in (-0.46, 0.46):
            parts += _wheel(x, y, 0.27, 0.20)
    for s in (-1, 1):
        y = 0.553 * s
        for x0, x1 in ((-0.92, -0.05), (0.02, 0.62)):  # hatches, drawn by their seams
            seams = [((x0, 0.62), (x1, 0.635)), ((x0, 1.40), (x1, 1.415)), ((x0, 0.62), (x0 + 0.015, 1.415))]
            seams.append(((x1 - 0.015, 0.62), (x1, 1.415)))
            for (a, b), (c, d) in seams:
                parts.append(g.box((a, min(y, y - 0.02 * s), b), (c, max(y, y - 0.02 * s), d), materials.TRIM))
        parts.append(g.box((-0.15, min(y, y + 0.02 * s), 0.98), (-0.09, max(y, y + 0.02 * s), 1.12), materials.TRIM))
        parts.append(g.box((-1.0, min(y, y - 0.02 * s), 0.48), (1.0, max(y, y - 0.02 * s), 0.56), materials.TRIM))
    glass = [(0.935, 1.53), (1.095, 1.25), (1.175, 1.01)]
    parts.append(g.grid([[(x, y, z) for x, z in glass] for y in (0.42, -0.42)], materials.GLASS))
    parts += [g.box((1.15, y - 0.13, 0.66), (1.21, y + 0.13, 0.74), materials.HEADLAMP) for y in (-0.30, 0.30)]
    parts += [g.box((-1.215, y - 0.06, 0.72), (-1.17, y + 0.06, 0.95), materials.TAIL_LAMP) for y in (-0.38, 0.38)]
    parts += [
        g.rod((0.35, 0, 1.64), (0.35, 0, 1.76), (0.07, 0.07), materials.TRIM, 12),
        g.rod((0.35, 0, 1.74), (0.35, 0, 1.86), (0.11, 0.10), materials.GLASS, 12),
        g.rod((-0.85, 0.35, 1.6), (-0.85, 0.35, 2.35), (0.012, 0.008), materials.TRIM, 5),
        g.profile([(-0.85, 2.34), (-0.85, 2.18), (-1.10, 2.26)], 0.345, 0.355, materials.INDICATOR),
    ]
    return g.assemble(parts)


@cache
def service_cart(paint: str) -> Mesh:
    """Return a maintenance cart of 3 m: an open cab under a canopy, a load bed with tools, in a paint.

    Raises UsageError for an unknown paint.
    """
    shell, seat = materials.paint(paint), materials.plain("cart-seat", (58, 54, 50), 0.1)
    parts = [
        g.box((-1.45, -0.56, 0.34), (1.25, 0.56, 0.46), materials.TRIM),
        # the cowl, its windscreen, the canopy on four posts
        g.profile([(0.82, 0.46), (1.46, 0.46), (1.50, 0.62), (1.38, 0.86), (0.86, 1.02)], -0.60, 0.60, shell),
        g.profile([(0.10, 0.46), (0.46, 0.46), (0.46, 0.80), (0.10, 0.80)], -0.58, 0.58, shell),
        g.box((0.04, -0.56, 0.80), (0.50, 0.56, 0.92), seat),
        g.profile([(-0.02, 0.86), (0.10, 0.86), (0.02, 1.36), (-0.08, 1.36)], -0.54, 0.54, seat),
        g.profile([(-0.20, 1.90), (1.02, 1.90), (1.06, 1.94), (0.94, 2.00), (-0.14, 2.00)], -0.66, 0.66, shell),
    ]
    for y in (-0.56, 0.56):
        parts.append(g.rod((0.90, y, 0.98), (0.70, y, 1.92), (0.03, 0.03), materials.TRIM, 6))
        parts.append(g.rod((-0.12, y, 0.46), (-0.12, y, 1.92), (0.03, 0.03), materials.TRIM, 6))
    parts.append(
        g.quad([(0.885, -0.53, 1.0), (0.885, 0.53, 1.0), (0.80, 0.53, 1.42), (0.80, -0.53, 1.42)], materials.GLASS)
    )
    parts.append(
        g.quad([(0.87, 0.53, 1.0), (0.87, -0.53, 1.0), (0.785, -0.53, 1.42), (0.785, 0.53, 1.42)], materials.GLASS)
    )
    hub = np.array((0.62, 0.26, 1.10))
    ring = [
        hub + 0.17 * np.array((0.55 * np.sin(a), np.cos(a), 0.83 * np.sin(a))) for a in np.linspace(0, 2 * np.pi, 11)
    ]
    parts += [g.rod(p, q, (0.016, 0.016), materials.TRIM, 5) for p, q in itertools.pairwise(ring)]
    parts.append(g.rod((0.86, 0.26, 0.92), hub, (0.03, 0.025), materials.TRIM, 6))
    # the bed: floor, three boards, and what lies in it
    parts.append(g.box((-1.50, -0.62, 0.60), (-0.18, 0.62, 0.66), shell))
    parts += [g.box((-1.50, y - 0.025, 0.66), (-0.18, y + 0.025, 0.98), shell) for y in (-0.595, 0.595)]
    parts += [g.box((x - 0.025, -0.62, 0.66), (x + 0.025, 0.62, 0.98), shell) for x in (-1.475, -0.20)]
    parts.append(g.box((-0.95, -0.35, 0.46), (-0.45, 0.35, 0.60), materials.TRIM))
    parts.append(g.box((-1.30, -0.48, 0.66), (-0.72, -0.05, 1.22), materials.plain("crate", (150, 124, 88))))
    parts.append(
        g.rod((-0.50, 0.22, 0.66), (-0.50, 0.22, 1.30), (0.20, 0.22), materials.plain("tub", (86, 92, 96)), 14)
    )
    broom = surface("boards")
    parts.append(g.rod((-1.20, 0.42, 0.72), (-0.32, 0.50, 1.66), (0.018, 0.018), broom, 6))
    parts.append(g.box((-0.42, 0.34, 1.60), (-0.30, 0.60, 1.74), materials.plain("bristles", (176, 150, 92))))
    for x in (-0.88, 1.02):
        for y in (-0.54, 0.54):
            parts += _wheel(x, y, 0.28, 0.20)
            parts.append(
                g.box(
                    (x - 0.34, min(y * 0.78, y * 1.2), 0.56), (x + 0.34, max(y * 0.78, y * 1.2), 0.61), materials.TRIM
                )
            )
    parts += [g.ball((1.47, y, 0.72), (0.05, 0.09, 0.07), materials.HEADLAMP, 1) for y in (-0.42, 0.42)]
    parts += [g.box((-1.52, y - 0.08, 0.70), (-1.49, y + 0.08, 0.80), materials.TAIL_LAMP) for y in (-0.48, 0.48)]
    parts.append(g.rod((0.4, 0, 2.0), (0.4, 0, 2.12), (0.07, 0.06), materials.INDICATOR, 10))
    return g.assemble(parts)
