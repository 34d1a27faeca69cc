"""Builds meshes of a cyclist and a motorcyclist with their vehicles. A paint sets the colour of vehicle and helmet."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.people import Outfit, Posture, body, outfit_of
from episodes.maps.assets.vehicles import about_y, plates
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

MOTORCYCLE_SIZE = 1.06  # scale of motorcycle and rider: 2.4 m long, like the largest touring motorcycles
SADDLE = materials.plain("saddle", (30, 28, 28), 0.15)
ALLOY = materials.plain("alloy", (150, 153, 158), 0.6)
FORWARD = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))  # both feet point forward


RIDER = Posture(
    hip=(-0.22, 0.0, 1.00), chest=(0.20, 0.0, 1.42), head=(0.33, 0.0, 1.61),
    knees=((0.16, -0.11, 0.80), (0.10, 0.11, 0.62)), ankles=((-0.02, -0.12, 0.40), (-0.10, 0.12, 0.19)),
    elbows=((0.36, -0.27, 1.20), (0.36, 0.27, 1.20)), hands=((0.56, -0.25, 1.03), (0.56, 0.25, 1.03)), toes=FORWARD,
)  # fmt: skip
BIKER = Posture(
    hip=(-0.30, 0.0, 0.90), chest=(-0.14, 0.0, 1.40), head=(-0.06, 0.0, 1.62),
    knees=((0.16, -0.24, 0.76), (0.16, 0.24, 0.76)), ankles=((-0.14, -0.26, 0.40), (-0.14, 0.26, 0.40)),
    elbows=((0.12, -0.36, 1.14), (0.12, 0.36, 1.14)), hands=((0.40, -0.34, 1.08), (0.40, 0.34, 1.08)), toes=FORWARD,
)  # fmt: skip
BIKER_OUTFIT = Outfit(shoes=(30, 30, 32), legs=(34, 35, 38))


def tyre(radius: float, thick: float, material: Material = materials.RUBBER, segments: int = 28) -> MeshPart:
    """Return a torus around the y axis, centred at the origin. `radius` (m) is the outer radius."""
    turn = np.linspace(0.0, 2.0 * np.pi, 9)
    middle = radius - thick / 2
    return about_y(g.lathe([(middle + thick / 2 * np.cos(a), thick / 2 * np.sin(a)) for a in turn], material, segments))


def _spoked(x: float, radius: float, spokes: int) -> list[MeshPart]:
    """Return the wheel of a bicycle. It touches the ground at x."""
    solids = [tyre(radius, 0.045), tyre(radius - 0.035, 0.028, ALLOY, 24)]
    for k in range(spokes):
        a = 2 * np.pi * k / spokes
        y = 0.025 if k % 2 else -0.025
        rim = ((radius - 0.05) * np.cos(a), 0.0, (radius - 0.05) * np.sin(a))
        solids.append(g.rod((0.0, y, 0.0), rim, (0.005, 0.004), ALLOY, 3))
    solids.append(g.rod((0, -0.05, 0), (0, 0.05, 0), (0.03, 0.03), ALLOY, 8))
    return [g.transformed(p, (x, 0.0, radius)) for p in solids]


@cache
def cyclist(paint: str) -> Mesh:
    """Return a bicycle and its rider; `paint` colours frame, helmet and jacket.

    Raises UsageError for an unknown paint.
    """
    frame, radius = materials.paint(paint), 0.345
    rear, front = -0.52, 0.53
    crank, seat, head = (-0.07, 0.0, 0.29), (-0.24, 0.0, 0.84), (0.40, 0.0, 0.86)
    solids = [*_spoked(rear, radius, 20), *_spoked(front, radius, 20)]
    tubes = [(crank, seat, 0.021), (crank, (0.43, 0.0, 0.70), 0.026), (seat, head, 0.021)]
    tubes += [(head, (0.46, 0.0, 0.62), 0.026), (head, (0.36, 0.0, 1.0), 0.018)]
    for y in (-0.06, 0.06):
        tubes += [((-0.07, y / 2, 0.29), (rear, y, radius), 0.013), ((-0.22, y / 3, 0.78), (rear, y, radius), 0.011)]
        tubes += [((0.46, y, 0.62), (front, y, radius), 0.016)]
    solids += [g.rod(a, b, (r, r), frame, 8) for a, b, r in tubes]
    # saddle, handlebar with grips, chain ring, chain, cranks with pedals, mudguard, lamps
    solids.append(g.hull(
        [(-0.38, -0.08, 0.88), (-0.10, -0.02, 0.88), (-0.10, 0.02, 0.88), (-0.38, 0.08, 0.88)],
        [(-0.37, -0.07, 0.94), (-0.11, -0.015, 0.92), (-0.11, 0.015, 0.92), (-0.37, 0.07, 0.94)], SADDLE))  # fmt: skip
    solids.append(g.rod(seat, (-0.25, 0, 0.90), (0.015, 0.015), ALLOY, 6))
    bar = [(0.56, -0.29, 1.01), (0.42, -0.12, 1.03), (0.36, 0.0, 1.0), (0.42, 0.12, 1.03), (0.56, 0.29, 1.01)]
    solids += [g.rod(a, b, (0.014, 0.014), ALLOY, 6) for a, b in itertools.pairwise(bar)]
    solids.append(g.transformed(tyre(0.10, 0.02, materials.TRIM, 16), (-0.07, -0.05, 0.29)))
    for z in (0.385, 0.21):
        solids.append(
            g.rod((-0.07, -0.05, z), (rear, -0.05, radius + (z - 0.29) * 0.3), (0.008, 0.008), materials.TRIM, 4)
        )
    for y, end in ((-0.11, (-0.02, 0.37)), (0.11, (-0.10, 0.14))):
        solids.append(g.rod((-0.07, y * 0.6, 0.29), (end[0], y * 0.8, end[1]), (0.014, 0.012), ALLOY, 6))
        solids.append(g.box((end[0] - 0.05, y - 0.045, end[1] - 0.015), (end[0] + 0.05, y + 0.045, end[1] + 0.015),
                           materials.TRIM))  # fmt: skip
    solids.append(g.ball((0.52, 0.0, 0.92), (0.03, 0.03, 0.03), materials.HEADLAMP, 1))
    solids.append(g.box((-0.40, -0.03, 0.76), (-0.37, 0.03, 0.82), materials.TAIL_LAMP))
    return g.assemble(solids + body(RIDER, paint, replace(outfit_of(paint), bag="none"), frame))


def _motor_wheel(x: float, radius: float, thick: float) -> list[MeshPart]:
    solids = [tyre(radius, thick), tyre(radius - 0.7 * thick, 0.4 * thick, materials.RIM, 24)]
    for k in range(5):
        a = 2 * np.pi * k / 5
        solids.append(g.rod((0, 0, 0), (0.75 * radius * np.cos(a), 0, 0.75 * radius * np.sin(a)), (0.03, 0.022),
                           materials.RIM, 5))  # fmt: skip
    solids.append(g.rod((0, -0.07, 0), (0, 0.07, 0), (0.05, 0.05), materials.RIM, 10))
    for y in (-0.065, 0.065):
        solids.append(g.rod((0, y - 0.004, 0), (0, y + 0.004, 0), (0.15, 0.15), ALLOY, 16))
    return [g.transformed(p, (x, 0.0, radius)) for p in solids]


@cache
def motorcycle(paint: str, plate: str) -> Mesh:
    """Return a touring motorcycle with panniers and its rider. `paint` colours tank, fairing, cases and helmet.

    Raises UsageError for an unknown paint.
    """
    shell = materials.paint(paint)
    rear, front = -0.74, 0.76
    solids = [*_motor_wheel(rear, 0.32, 0.17), *_motor_wheel(front, 0.31, 0.13)]
    # engine, exhausts, frame, fork
    solids.append(g.box((-0.28, -0.20, 0.24), (0.26, 0.20, 0.52), materials.STEEL))
    for z in (0.40, 0.47):
        solids.append(g.box((-0.05, -0.25, z), (0.20, 0.25, z + 0.03), ALLOY))
    for y in (-0.24, 0.24):
        solids.append(g.rod((0.18, y * 0.8, 0.30), (-0.35, y, 0.28), (0.035, 0.035), materials.CHROME, 8))
        solids.append(g.rod((-0.35, y, 0.28), (-1.0, y, 0.40), (0.05, 0.06), materials.CHROME, 10))
        solids.append(g.rod((0.42, y * 0.42, 0.98), (front, y * 0.42, 0.31), (0.032, 0.036), ALLOY, 8))
        solids.append(g.rod((rear, y * 0.5, 0.32), (-0.15, y * 0.5, 0.42), (0.035, 0.035), materials.TRIM, 6))
    # tank, seat, tail, fairing with windscreen, mudguard
    solids.append(g.ball((0.10, 0.0, 0.82), (0.34, 0.20, 0.17), shell, 2))
    solids.append(g.profile([(-0.62, 0.74), (-0.08, 0.72), (-0.06, 0.80), (-0.34, 0.84), (-0.66, 0.92)], -0.17, 0.17,
                           SADDLE))  # fmt: skip
    solids.append(g.profile([(-0.98, 0.80), (-0.30, 0.58), (-0.10, 0.70), (-0.60, 0.76), (-0.98, 0.88)], -0.14, 0.14,
                           shell))  # fmt: skip
    nose = [(0.34, 0.56), (0.62, 0.62), (0.74, 0.82), (0.66, 1.02), (0.46, 1.10), (0.30, 0.90)]
    inner = g.profile(nose, -0.17, 0.17, shell)
    solids.append(inner)
    for s in (-1.0, 1.0):
        low = [(x, s * 0.17, z) for x, z in nose]
        high = [(x * 0.7 + 0.12, s * 0.30, 0.86 + (z - 0.84) * 0.62) for x, z in nose]
        ring = [low, high] if s > 0 else [high, low]
        closed = [[*r, r[0]] for r in ring]
        solids.append(g.grid(np.array(closed), shell, 50.0))
        solids.append(g.cap(high, shell, faces_back=s > 0))
    screen = np.array([[(0.66, -0.24, 1.03), (0.66, 0.24, 1.03)], [(0.44, -0.20, 1.38), (0.44, 0.20, 1.38)]])
    solids += [g.grid(screen[::-1], materials.GLASS), g.grid(screen - (0.012, 0, 0), materials.GLASS)]
    arc = np.linspace(0.25 * np.pi, 0.9 * np.pi, 9)
    guard = np.array([[(front + r * np.cos(a), y, 0.31 + r * np.sin(a)) for a in arc] for y, r in
                      ((-0.09, 0.34), (-0.05, 0.365), (0.05, 0.365), (0.09, 0.34))])  # fmt: skip
    solids += [g.grid(guard, shell, 50.0), g.grid(guard[::-1] - (0, 0, 0.004), materials.TRIM, 50.0)]
    # panniers, top case, and panels that shield the rider's legs
    for s in (-1.0, 1.0):
        y0, y1 = sorted((s * 0.24, s * 0.53))
        solids.append(g.box((-1.16, y0, 0.40), (-0.54, y1, 0.86), shell))
        solids.append(g.box((-1.17, y0 - 0.005, 0.68), (-0.53, y1 + 0.005, 0.70), materials.TRIM))
        y0, y1 = sorted((s * 0.19, s * 0.29))
        panel = [(-0.02, 0.24), (0.40, 0.22), (0.52, 0.40), (0.62, 0.74), (0.34, 0.86), (0.16, 0.52)]
        solids.append(g.profile(panel, y0, y1, shell))
    solids.append(g.frustum(((-1.20, -0.30), (-0.70, 0.30)), ((-1.14, -0.25), (-0.76, 0.25)), (0.94, 1.32), shell))
    solids.append(g.box((-1.05, -0.10, 0.84), (-0.80, 0.10, 0.96), materials.TRIM))
    # lamps, mirrors, handlebar, plate
    solids.append(g.ball((0.70, 0.0, 0.86), (0.06, 0.12, 0.08), materials.HEADLAMP, 2))
    solids.append(g.box((-1.225, -0.18, 1.00), (-1.15, 0.18, 1.10), materials.TAIL_LAMP))
    for s in (-1.0, 1.0):
        solids.append(g.ball((0.52, s * 0.27, 0.88), (0.05, 0.03, 0.03), materials.INDICATOR, 1))
        solids.append(g.rod((0.44, s * 0.05, 1.05), (0.38, s * 0.42, 1.08), (0.016, 0.018), materials.TRIM, 6))
        solids.append(g.rod((0.46, s * 0.26, 1.06), (0.46, s * 0.40, 1.24), (0.010, 0.010), materials.TRIM, 5))
        solids.append(g.ball((0.46, s * 0.43, 1.26), (0.02, 0.08, 0.05), materials.TRIM, 1))
    large = [
        replace(p, corners=p.corners * MOTORCYCLE_SIZE) for p in [*solids, *body(BIKER, "black", BIKER_OUTFIT, shell)]
    ]
    rear_plate = plates(plate, (-1.195 * MOTORCYCLE_SIZE, 0.62), (0.0, 0.0))[0]  # not scaled: letters have a fixed size
    return g.assemble([*large, rear_plate])
