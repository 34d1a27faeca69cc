"""A city bus of ten metres: a tall lofted body, a band of windows, two folding doors, a destination above them."""

import itertools
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import lettering, materials
from episodes.maps.assets.vehicles import CarShape, body, plan_at, plates, wheel
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

LENGTH, WIDTH, ROOF = 10.2, 2.35, 2.92
SHAPE = CarShape(
    LENGTH, WIDTH, 5.6, 0.47, 0.34,
    ((-5.1, 2.72), (-4.95, 2.86), (-4.0, 2.90), (4.0, 2.90), (4.95, 2.86), (5.1, 2.72)),
    (0.0, 0.0), (0.0, 0.0), 1.25, ROOF, (), (0.0, 0.0),
)  # fmt: skip
SILL, LINTEL = 1.22, 2.36  # m, lower and upper edge of the windows
PANES = (-4.75, -3.30, -1.85, -0.40, 1.05, 2.50, 3.55)  # x of the uprights between the side windows
DOORS = ((3.72, 4.72), (-0.30, 0.95))  # x reach of the doors, on the right
PROUD = 0.012


def _pane(x0: float, x1: float, z0: float, z1: float, side: float, look: Material, proud: float = PROUD) -> MeshPart:
    """Return a flat piece set on the body's flank, `side` +1 on the left."""
    y0, y1 = (side * (float(plan_at(SHAPE, np.array([x]))[0]) + proud) for x in (x0, x1))
    ring = [(x0, y0, z0), (x1, y1, z0), (x1, y1, z1), (x0, y0, z1)]
    return g.quad(ring if side < 0 else [ring[1], ring[0], ring[3], ring[2]], look)


def _across(x: float, half: float, z0: float, z1: float, look: Material) -> MeshPart:
    """Return a flat piece set on the nose (x > 0) or the tail."""
    s = 1.0 if x > 0 else -1.0
    return g.quad([(x, -s * half, z0), (x, s * half, z0), (x, s * half, z1), (x, -s * half, z1)], look)


def _flanks() -> list[MeshPart]:
    """Return windows, doors and trim of both sides."""
    parts = []
    for a, b in itertools.pairwise(PANES):
        for side in (1.0, -1.0):
            behind_door = side < 0 and any(a < d1 and b > d0 for d0, d1 in DOORS)
            if not behind_door:
                parts.append(_pane(a + 0.05, b - 0.05, SILL, LINTEL, side, materials.GLASS))
    parts.append(_pane(3.72, 4.72, SILL, LINTEL, 1.0, materials.GLASS))  # beside the driver
    parts.append(_pane(-1.75, -0.42, SILL, LINTEL, -1.0, materials.GLASS))
    parts.append(_pane(1.07, 2.45, SILL, LINTEL, -1.0, materials.GLASS))
    for x0, x1 in DOORS:
        middle = (x0 + x1) / 2
        parts.append(_pane(x0, x1, 0.42, LINTEL + 0.06, -1.0, materials.TRIM, 0.010))
        for a, b in ((x0 + 0.05, middle - 0.03), (middle + 0.03, x1 - 0.05)):
            parts.append(_pane(a, b, 0.50, LINTEL, -1.0, materials.WINDOW, 0.020))
    for side in (1.0, -1.0):
        spans = [(-4.9, -3.45), (-2.15, 2.15), (3.45, 4.9)]
        for a, b in spans:
            for c, d in ((a, min(b, 0.0)), (max(a, 0.0), b)) if a < 0 < b else ((a, b),):
                parts.append(_pane(c, d, 0.40, 0.50, side, materials.TRIM, 0.016))
        for x in (-4.6, -2.0, 2.0, 4.8):
            parts.append(_pane(x - 0.05, x + 0.05, 0.62, 0.70, side, materials.INDICATOR, 0.02))
    return parts


def _ends(text: str) -> list[MeshPart]:
    """Return screens, lamps, bumpers, mirrors, and the destination at the front."""
    nose, tail = LENGTH / 2 + PROUD, -LENGTH / 2 - PROUD
    half = float(plan_at(SHAPE, np.array([LENGTH / 2]))[0])
    glow = lettering.plate(text, (255, 176, 40), (18, 18, 20))
    lit = Material(f"destination-{text}", (1.0, 1.0, 1.0), glow, emission=0.5)
    wide = 0.30 * glow.shape[1] / glow.shape[0] / 2
    parts = [
        _across(nose, half - 0.06, 1.02, 2.32, materials.GLASS),
        _across(nose, half - 0.06, 2.32, 2.72, materials.TRIM),
        _across(nose + 0.006, min(wide, half - 0.1), 2.37, 2.67, lit),
        _across(tail, half - 0.16, 1.50, 2.36, materials.GLASS),
        _across(tail, half - 0.30, 0.78, 1.36, materials.TRIM),  # engine grille
        g.box((LENGTH / 2 - 0.10, -half, 0.36), (nose + 0.05, half, 0.62), materials.TRIM),
        g.box((tail - 0.05, -half, 0.36), (-LENGTH / 2 + 0.10, half, 0.60), materials.TRIM),
        g.box((nose, -0.02, 1.02), (nose + 0.01, 0.02, 2.32), materials.TRIM),
    ]
    for z in np.arange(0.86, 1.34, 0.12):
        parts.append(g.box((tail - 0.012, -half + 0.34, z), (tail, half - 0.34, z + 0.03), materials.STEEL))
    pair = [
        g.box((nose - 0.05, half - 0.42, 0.70), (nose + 0.02, half - 0.06, 0.90), materials.HEADLAMP),
        g.box((nose - 0.05, half - 0.16, 0.92), (nose + 0.02, half - 0.06, 1.00), materials.INDICATOR),
        g.box((tail - 0.02, half - 0.24, 0.84), (tail + 0.05, half - 0.04, 1.30), materials.TAIL_LAMP),
        g.box((tail - 0.02, half - 0.24, 0.70), (tail + 0.05, half - 0.04, 0.82), materials.INDICATOR),
        g.rod((nose - 0.15, half + 0.05, 2.58), (nose + 0.06, half + 0.20, 2.50), (0.02, 0.02), materials.TRIM, 6),
        g.box((nose + 0.00, half + 0.08, 2.02), (nose + 0.09, half + 0.30, 2.48), materials.TRIM),
        # a wiper from the foot of the screen
        g.rod((nose + 0.012, 0.25, 1.04), (nose + 0.02, 0.80, 1.46), (0.012, 0.008), materials.TRIM, 4),
    ]
    return parts + pair + [g.mirrored(p) for p in pair]


@cache
def bus(paint: str, plate: str) -> Mesh:
    """Return a bus in a paint with `plate` on both number plates. Raises UsageError for an unknown paint."""
    shell = materials.paint(paint)
    parts = [*body(SHAPE, shell), *_flanks(), *_ends("7 CENTRE")]
    one = wheel(SHAPE.wheel_radius, 0.30)
    for x in (-SHAPE.wheelbase / 2, SHAPE.wheelbase / 2):
        left = [g.placed(p, (x, WIDTH / 2 - 0.20, SHAPE.wheel_radius)) for p in one]
        parts += left + [g.mirrored(p) for p in left]
    parts.append(g.box((-4.6, -0.82, 0.36), (4.6, 0.82, 1.1), materials.SHADOW))
    # air conditioning and hatches on the roof
    parts.append(g.hull(
        [(-3.4, -0.80, 2.86), (-0.6, -0.80, 2.86), (-0.6, 0.80, 2.86), (-3.4, 0.80, 2.86)],
        [(-3.2, -0.68, 3.12), (-0.9, -0.68, 3.12), (-0.9, 0.68, 3.12), (-3.2, 0.68, 3.12)], shell))  # fmt: skip
    parts.append(g.box((1.6, -0.4, 2.9), (2.4, 0.4, 3.02), materials.TRIM))
    half = LENGTH / 2 + PROUD + 0.056
    parts += plates(plate, (-half, 0.40), (half, 0.40))
    return g.assemble(parts)
