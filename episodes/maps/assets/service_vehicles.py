"""Builds meshes of a city bus (10 m long), and of the slow vehicles of the campus: a delivery robot, a service cart."""

import itertools
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import lettering, materials
from episodes.maps.assets.materials import surface
from episodes.maps.assets.vehicles import CarShape, body, plan_at, plates, wheel
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

LENGTH, WIDTH, ROOF = 10.2, 2.35, 2.92  # m
SHAPE = CarShape(
    LENGTH, WIDTH, 5.6, 0.47, 0.34,
    ((-5.1, 2.72), (-4.95, 2.86), (-4.0, 2.90), (4.0, 2.90), (4.95, 2.86), (5.1, 2.72)),
    (0.0, 0.0), (0.0, 0.0), 1.25, ROOF, (), (0.0, 0.0),
)  # fmt: skip
SILL, LINTEL = 1.22, 2.36  # m, lower and upper edge of the windows
PANES = (-4.75, -3.30, -1.85, -0.40, 1.05, 2.50, 3.55)  # x of the uprights between the side windows
DOORS = ((3.72, 4.72), (-0.30, 0.95))  # x range of each door, on the right side
PROUD = 0.012  # m, distance of panes and trim from the body


def _pane(x0: float, x1: float, z0: float, z1: float, side: float, look: Material, proud: float = PROUD) -> MeshPart:
    """Return a flat panel on the side of the body; `side` is +1 on the left and -1 on the right."""
    y0, y1 = (side * (float(plan_at(SHAPE, np.array([x]))[0]) + proud) for x in (x0, x1))
    ring = [(x0, y0, z0), (x1, y1, z0), (x1, y1, z1), (x0, y0, z1)]
    return g.quad(ring if side < 0 else [ring[1], ring[0], ring[3], ring[2]], look)


def _across(x: float, half: float, z0: float, z1: float, look: Material) -> MeshPart:
    """Return a flat panel on the front (x > 0) or the rear of the body."""
    s = 1.0 if x > 0 else -1.0
    return g.panel(x, (-s * half, s * half), (z0, z1), look)


def _flanks() -> list[MeshPart]:
    """Return windows, doors and trim of both sides."""
    solids = []
    for a, b in itertools.pairwise(PANES):
        for side in (1.0, -1.0):
            behind_door = side < 0 and any(a < d1 and b > d0 for d0, d1 in DOORS)
            if not behind_door:
                solids.append(_pane(a + 0.05, b - 0.05, SILL, LINTEL, side, materials.GLASS))
    solids.append(_pane(3.72, 4.72, SILL, LINTEL, 1.0, materials.GLASS))  # beside the driver
    solids.append(_pane(-1.75, -0.42, SILL, LINTEL, -1.0, materials.GLASS))
    solids.append(_pane(1.07, 2.45, SILL, LINTEL, -1.0, materials.GLASS))
    for x0, x1 in DOORS:
        middle = (x0 + x1) / 2
        solids.append(_pane(x0, x1, 0.42, LINTEL + 0.06, -1.0, materials.TRIM, 0.010))
        for a, b in ((x0 + 0.05, middle - 0.03), (middle + 0.03, x1 - 0.05)):
            solids.append(_pane(a, b, 0.50, LINTEL, -1.0, materials.WINDOW, 0.020))
    for side in (1.0, -1.0):
        spans = [(-4.9, -3.45), (-2.15, 2.15), (3.45, 4.9)]
        for a, b in spans:
            for c, d in ((a, min(b, 0.0)), (max(a, 0.0), b)) if a < 0 < b else ((a, b),):
                solids.append(_pane(c, d, 0.40, 0.50, side, materials.TRIM, 0.016))
        for x in (-4.6, -2.0, 2.0, 4.8):
            solids.append(_pane(x - 0.05, x + 0.05, 0.62, 0.70, side, materials.INDICATOR, 0.02))
    return solids


def _ends(text: str) -> list[MeshPart]:
    """Return windscreens, lamps, bumpers, mirrors, and the destination display at the front."""
    nose, tail = LENGTH / 2 + PROUD, -LENGTH / 2 - PROUD
    half = float(plan_at(SHAPE, np.array([LENGTH / 2]))[0])
    glow = lettering.plate(text, (255, 176, 40), (18, 18, 20))
    lit = Material(f"destination-{text}", (1.0, 1.0, 1.0), glow, emission=0.5)
    wide = 0.30 * glow.shape[1] / glow.shape[0] / 2
    solids = [
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
        solids.append(g.box((tail - 0.012, -half + 0.34, z), (tail, half - 0.34, z + 0.03), materials.STEEL))
    pair = [
        g.box((nose - 0.05, half - 0.42, 0.70), (nose + 0.02, half - 0.06, 0.90), materials.HEADLAMP),
        g.box((nose - 0.05, half - 0.16, 0.92), (nose + 0.02, half - 0.06, 1.00), materials.INDICATOR),
        g.box((tail - 0.02, half - 0.24, 0.84), (tail + 0.05, half - 0.04, 1.30), materials.TAIL_LAMP),
        g.box((tail - 0.02, half - 0.24, 0.70), (tail + 0.05, half - 0.04, 0.82), materials.INDICATOR),
        g.rod((nose - 0.15, half + 0.05, 2.58), (nose + 0.06, half + 0.20, 2.50), (0.02, 0.02), materials.TRIM, 6),
        g.box((nose + 0.00, half + 0.08, 2.02), (nose + 0.09, half + 0.30, 2.48), materials.TRIM),
        # a wiper at the lower edge of the windscreen
        g.rod((nose + 0.012, 0.25, 1.04), (nose + 0.02, 0.80, 1.46), (0.012, 0.008), materials.TRIM, 4),
    ]
    return solids + pair + [g.mirrored(p) for p in pair]


@cache
def bus(paint: str, plate: str) -> Mesh:
    """Return a bus in a paint with `plate` on both number plates. Raises UsageError for an unknown paint."""
    shell = materials.paint(paint)
    solids = [*body(SHAPE, shell), *_flanks(), *_ends("7 CENTRE")]
    wheel_solids = wheel(SHAPE.wheel_radius, 0.30)
    for x in (-SHAPE.wheelbase / 2, SHAPE.wheelbase / 2):
        left = [g.transformed(p, (x, WIDTH / 2 - 0.20, SHAPE.wheel_radius)) for p in wheel_solids]
        solids += left + [g.mirrored(p) for p in left]
    solids.append(g.box((-4.6, -0.82, 0.36), (4.6, 0.82, 1.1), materials.SHADOW))
    # air conditioning and hatches on the roof
    solids.append(g.frustum(((-3.4, -0.80), (-0.6, 0.80)), ((-3.2, -0.68), (-0.9, 0.68)), (2.86, 3.12), shell))
    solids.append(g.box((1.6, -0.4, 2.9), (2.4, 0.4, 3.02), materials.TRIM))
    half = LENGTH / 2 + PROUD + 0.056
    solids += plates(plate, (-half, 0.40), (half, 0.40))
    return g.assemble(solids)


def _wheel(x: float, y: float, radius: float, width: float) -> list[MeshPart]:
    """Return a wheel that touches the ground, with its hub on the outer side."""
    out = np.sign(y) * width / 2
    return [
        g.rod((x, y - out, radius), (x, y + out, radius), (radius, radius), materials.RUBBER, 20),
        g.rod(
            (x, y + out * 0.9, radius), (x, y + out * 1.12, radius), (radius * 0.62, radius * 0.5), materials.RIM, 12
        ),
    ]


@cache
def delivery_robot(paint: str) -> Mesh:
    """Return a delivery pod, 2.4 m long, with four wheels and side hatches. Raises UsageError for an unknown paint.

    The pod has the size of pods that drive on roads. A pavement robot of 0.7 m would fill less than 0.1 % of the
    picture, seen from the start places of the campus. A target must fill at least 0.25 %.
    """
    shell = materials.paint(paint)
    side = [(-1.15, 0.42), (-1.20, 0.75), (-1.16, 1.35), (-1.02, 1.58), (-0.75, 1.66), (0.55, 1.66), (0.85, 1.56)]
    side += [(1.08, 1.22), (1.19, 0.80), (1.20, 0.55), (1.12, 0.42)]
    rings = []
    for y, k in ((-0.55, 0.93), (-0.49, 0.985), (-0.40, 1.0), (0.40, 1.0), (0.49, 0.985), (0.55, 0.93)):
        rings.append([(x * k, y, 1.03 + (z - 1.03) * k) for x, z in [*side, side[0]]])
    skin = g.grid(np.array(rings)[::-1], shell, 40.0)
    caps = [g.cap(rings[0][:-1], shell, faces_back=True), g.cap(rings[-1][:-1], shell)]
    solids = [skin, *caps, g.box((-0.95, -0.46, 0.26), (0.95, 0.46, 0.46), materials.TRIM)]
    for x in (-0.72, 0.72):
        for y in (-0.46, 0.46):
            solids += _wheel(x, y, 0.27, 0.20)
    for s in (-1, 1):
        y = 0.553 * s
        for x0, x1 in ((-0.92, -0.05), (0.02, 0.62)):  # hatches, drawn as seams
            seams = [((x0, 0.62), (x1, 0.635)), ((x0, 1.40), (x1, 1.415)), ((x0, 0.62), (x0 + 0.015, 1.415))]
            seams.append(((x1 - 0.015, 0.62), (x1, 1.415)))
            for (a, b), (c, d) in seams:
                solids.append(g.box((a, min(y, y - 0.02 * s), b), (c, max(y, y - 0.02 * s), d), materials.TRIM))
        solids.append(g.box((-0.15, min(y, y + 0.02 * s), 0.98), (-0.09, max(y, y + 0.02 * s), 1.12), materials.TRIM))
        solids.append(g.box((-1.0, min(y, y - 0.02 * s), 0.48), (1.0, max(y, y - 0.02 * s), 0.56), materials.TRIM))
    glass = [(0.935, 1.53), (1.095, 1.25), (1.175, 1.01)]
    solids.append(g.grid([[(x, y, z) for x, z in glass] for y in (0.42, -0.42)], materials.GLASS))
    solids += [g.box((1.15, y - 0.13, 0.66), (1.21, y + 0.13, 0.74), materials.HEADLAMP) for y in (-0.30, 0.30)]
    solids += [g.box((-1.215, y - 0.06, 0.72), (-1.17, y + 0.06, 0.95), materials.TAIL_LAMP) for y in (-0.38, 0.38)]
    solids += [
        g.rod((0.35, 0, 1.64), (0.35, 0, 1.76), (0.07, 0.07), materials.TRIM, 12),
        g.rod((0.35, 0, 1.74), (0.35, 0, 1.86), (0.11, 0.10), materials.GLASS, 12),
        g.rod((-0.85, 0.35, 1.6), (-0.85, 0.35, 2.35), (0.012, 0.008), materials.TRIM, 5),
        g.profile([(-0.85, 2.34), (-0.85, 2.18), (-1.10, 2.26)], 0.345, 0.355, materials.INDICATOR),
    ]
    return g.assemble(solids)


@cache
def service_cart(paint: str) -> Mesh:
    """Return a maintenance cart, 3 m long, with an open cab under a canopy and a load bed with tools.

    Raises UsageError for an unknown paint.
    """
    shell, seat = materials.paint(paint), materials.plain("cart-seat", (58, 54, 50), 0.1)
    solids = [
        g.box((-1.45, -0.56, 0.34), (1.25, 0.56, 0.46), materials.TRIM),
        # the cowl, the seat, the canopy
        g.profile([(0.82, 0.46), (1.46, 0.46), (1.50, 0.62), (1.38, 0.86), (0.86, 1.02)], -0.60, 0.60, shell),
        g.profile([(0.10, 0.46), (0.46, 0.46), (0.46, 0.80), (0.10, 0.80)], -0.58, 0.58, shell),
        g.box((0.04, -0.56, 0.80), (0.50, 0.56, 0.92), seat),
        g.profile([(-0.02, 0.86), (0.10, 0.86), (0.02, 1.36), (-0.08, 1.36)], -0.54, 0.54, seat),
        g.profile([(-0.20, 1.90), (1.02, 1.90), (1.06, 1.94), (0.94, 2.00), (-0.14, 2.00)], -0.66, 0.66, shell),
    ]
    for y in (-0.56, 0.56):
        solids.append(g.rod((0.90, y, 0.98), (0.70, y, 1.92), (0.03, 0.03), materials.TRIM, 6))
        solids.append(g.rod((-0.12, y, 0.46), (-0.12, y, 1.92), (0.03, 0.03), materials.TRIM, 6))
    solids.append(
        g.quad([(0.885, -0.53, 1.0), (0.885, 0.53, 1.0), (0.80, 0.53, 1.42), (0.80, -0.53, 1.42)], materials.GLASS)
    )
    solids.append(
        g.quad([(0.87, 0.53, 1.0), (0.87, -0.53, 1.0), (0.785, -0.53, 1.42), (0.785, 0.53, 1.42)], materials.GLASS)
    )
    hub = np.array((0.62, 0.26, 1.10))
    ring = [
        hub + 0.17 * np.array((0.55 * np.sin(a), np.cos(a), 0.83 * np.sin(a))) for a in np.linspace(0, 2 * np.pi, 11)
    ]
    solids += [g.rod(p, q, (0.016, 0.016), materials.TRIM, 5) for p, q in itertools.pairwise(ring)]
    solids.append(g.rod((0.86, 0.26, 0.92), hub, (0.03, 0.025), materials.TRIM, 6))
    # the bed: floor, four boards, and the load
    solids.append(g.box((-1.50, -0.62, 0.60), (-0.18, 0.62, 0.66), shell))
    solids += [g.box((-1.50, y - 0.025, 0.66), (-0.18, y + 0.025, 0.98), shell) for y in (-0.595, 0.595)]
    solids += [g.box((x - 0.025, -0.62, 0.66), (x + 0.025, 0.62, 0.98), shell) for x in (-1.475, -0.20)]
    solids.append(g.box((-0.95, -0.35, 0.46), (-0.45, 0.35, 0.60), materials.TRIM))
    solids.append(g.box((-1.30, -0.48, 0.66), (-0.72, -0.05, 1.22), materials.plain("crate", (150, 124, 88))))
    solids.append(
        g.rod((-0.50, 0.22, 0.66), (-0.50, 0.22, 1.30), (0.20, 0.22), materials.plain("tub", (86, 92, 96)), 14)
    )
    broom = surface("boards")
    solids.append(g.rod((-1.20, 0.42, 0.72), (-0.32, 0.50, 1.66), (0.018, 0.018), broom, 6))
    solids.append(g.box((-0.42, 0.34, 1.60), (-0.30, 0.60, 1.74), materials.plain("bristles", (176, 150, 92))))
    for x in (-0.88, 1.02):
        for y in (-0.54, 0.54):
            solids += _wheel(x, y, 0.28, 0.20)
            solids.append(
                g.box(
                    (x - 0.34, min(y * 0.78, y * 1.2), 0.56), (x + 0.34, max(y * 0.78, y * 1.2), 0.61), materials.TRIM
                )
            )
    solids += [g.ball((1.47, y, 0.72), (0.05, 0.09, 0.07), materials.HEADLAMP, 1) for y in (-0.42, 0.42)]
    solids += [g.box((-1.52, y - 0.08, 0.70), (-1.49, y + 0.08, 0.80), materials.TAIL_LAMP) for y in (-0.48, 0.48)]
    solids.append(g.rod((0.4, 0, 2.0), (0.4, 0, 2.12), (0.07, 0.06), materials.INDICATOR, 10))
    return g.assemble(solids)
