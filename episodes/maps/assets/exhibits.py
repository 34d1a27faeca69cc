"""Things on display: a large quadrotor on its stand, and a board on two posts that says something."""

from dataclasses import replace
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import lettering, materials
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

LETTER_M = 0.136  # height of a sign's letters (paper, appendix "Maps and Episodes")
BOARD_M = (1.2, 0.8)  # least width and height of a sign's board
BOARD_FOOT_M = 0.75  # m, its lower edge above the ground
QUADROTOR_SIZE = 1.16  # of the drawing below: 2.8 m over the propellers, as those that spray crops are
PAPER, INK = (242, 242, 238), (24, 26, 30)


def _rotor(x: float, y: float, z: float, turn: float) -> list[MeshPart]:
    """Return a motor with its propeller at rest."""
    parts = [
        g.rod((x, y, z - 0.10), (x, y, z + 0.06), (0.085, 0.075), materials.TRIM, 12),
        g.rod((x, y, z + 0.06), (x, y, z + 0.12), (0.035, 0.025), materials.CHROME, 8),
    ]
    blade = [(0.03, -0.02), (0.12, -0.055), (0.30, -0.05), (0.46, -0.02), (0.46, 0.02), (0.30, 0.025), (0.12, 0.03)]
    flat = g.prism([*blade, (0.03, 0.02)], 0.085, 0.100, materials.TRIM)
    tip = g.prism([(0.40, -0.035), (0.465, -0.02), (0.465, 0.021), (0.40, 0.022)], 0.084, 0.101, materials.WHITE_WOOD)
    for k in (0.0, np.pi):
        parts += [g.placed(p, (x, y, z), turn + k) for p in (flat, tip)]
    return parts


@cache
def quadrotor(paint: str) -> Mesh:
    """Return a crop-spraying quadrotor on a display stand, hull and stand in a paint. Raises UsageError."""
    shell, z = materials.paint(paint), 1.42
    ring = [(0.46, 0.0), (0.36, 0.20), (0.0, 0.27), (-0.36, 0.20), (-0.46, 0.0), (-0.36, -0.20), (0.0, -0.27)]
    ring.append((0.36, -0.20))

    def level(scale: float, height: float) -> np.ndarray:
        return np.array([(a * scale, b * scale, height) for a, b in ring])

    parts = [
        g.hull(level(0.70, z - 0.13), level(1.0, z - 0.02), shell),
        g.hull(level(1.0, z - 0.02), level(0.86, z + 0.09), shell),
        g.hull(level(0.86, z + 0.09), level(0.45, z + 0.17), shell),
        g.rod((-0.18, 0, z + 0.15), (-0.18, 0, z + 0.30), (0.02, 0.02), materials.TRIM, 6),
        g.rod((-0.18, 0, z + 0.29), (-0.18, 0, z + 0.33), (0.09, 0.09), materials.WHITE_WOOD, 12),
        # the camera below its nose
        g.box((0.30, -0.07, z - 0.20), (0.40, 0.07, z - 0.10), materials.TRIM),
        g.ball((0.39, 0.0, z - 0.20), (0.09, 0.09, 0.09), materials.TRIM, 2),
        g.rod((0.44, 0, z - 0.20), (0.49, 0, z - 0.20), (0.05, 0.055), materials.GLASS, 12),
    ]
    reach = 0.76
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        x, y = sx * reach, sy * reach
        parts.append(g.rod((sx * 0.24, sy * 0.14, z), (x, y, z + 0.02), (0.055, 0.042), shell, 10))
        parts += _rotor(x, y, z + 0.10, 0.6 + 1.1 * k)
        lamp = materials.TAIL_LAMP if sx < 0 else materials.HEADLAMP
        parts.append(g.ball((x + sx * 0.05, y + sy * 0.05, z - 0.02), (0.035, 0.035, 0.025), lamp, 1))
    for s in (-1, 1):  # skids
        for x in (-0.20, 0.20):
            parts.append(
                g.rod((x, s * 0.16, z - 0.10), (x * 1.3, s * 0.36, z - 0.40), (0.02, 0.018), materials.TRIM, 6)
            )
        parts.append(g.rod((-0.46, s * 0.36, z - 0.41), (0.46, s * 0.36, z - 0.41), (0.022, 0.022), materials.TRIM, 8))
    top = z - 0.43
    foot = materials.plain("stand", (74, 78, 84), 0.2)
    parts += [
        g.box((-0.66, -0.66, top - 0.07), (0.66, 0.66, top), foot),
        g.hull(
            [(-0.62, -0.62, 0.10), (0.62, -0.62, 0.10), (0.62, 0.62, 0.10), (-0.62, 0.62, 0.10)],
            [
                (-0.52, -0.52, top - 0.07),
                (0.52, -0.52, top - 0.07),
                (0.52, 0.52, top - 0.07),
                (-0.52, 0.52, top - 0.07),
            ],
            shell,
        ),
        g.box((-0.72, -0.72, 0.0), (0.72, 0.72, 0.10), foot),
    ]
    return g.assemble([replace(p, corners=p.corners * QUADROTOR_SIZE) for p in parts])


def contrasting(paint: str) -> tuple[int, int, int]:
    """Return the ink that reads best on a paint: near black or near white."""
    materials.paint(paint)  # raises for a paint that is not known
    r, g_, b = materials.linear(materials.PAINTS[paint])
    return INK if 0.2126 * r + 0.7152 * g_ + 0.0722 * b > 0.25 else PAPER


@cache
def sign(paint: str, text: str) -> Mesh:
    """Return a board in a paint on two posts, `text` on both faces in letters LETTER_M high.

    Raises UsageError for an unknown paint.
    """
    per_px = LETTER_M / lettering.CAP_PX
    least = (round(BOARD_M[1] / per_px), round(BOARD_M[0] / per_px))
    ink = contrasting(paint)
    srgb = materials.PAINTS[paint]
    picture = lettering.board(text, ink, srgb, least)
    face = Material(f"sign-{paint}-{text}", (1.0, 1.0, 1.0), picture, specular=0.05)
    shell = Material(f"paint-{paint}", materials.linear(srgb), specular=0.05)
    high, wide = picture.shape[0] * per_px, picture.shape[1] * per_px / 2
    low, x = BOARD_FOOT_M, 0.026
    parts = [
        g.box((-0.025, -wide - 0.03, low - 0.03), (0.025, wide + 0.03, low + high + 0.03), shell),
        g.quad([(x, -wide, low), (x, wide, low), (x, wide, low + high), (x, -wide, low + high)], face),
        g.quad([(-x, wide, low), (-x, -wide, low), (-x, -wide, low + high), (-x, wide, low + high)], face),
    ]
    for s in (-1, 1):
        y = s * (wide - 0.14)
        parts.append(g.box((-0.024, y - 0.04, 0.0), (0.024, y + 0.04, low), materials.STEEL))
        parts.append(g.box((-0.22, y - 0.07, 0.0), (0.22, y + 0.07, 0.03), materials.STEEL))
        parts.append(g.rod((0.20, y, 0.02), (-0.02, y, low - 0.02), (0.018, 0.018), materials.STEEL, 6))
    return g.assemble(parts)
