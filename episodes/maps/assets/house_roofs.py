"""Roofs of houses: gables, hips, dormers, solar panels, skylights and vents."""

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.house_fronts import window
from episodes.maps.assets.house_plans import HousePlan
from episodes.maps.assets.house_surfaces import HouseLooks
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material

PANEL = materials.plain("solar-panel", (26, 28, 32), 0.35)


def gable(
    low: tuple[float, float],
    high: tuple[float, float],
    eave: float,
    pitch: float,
    along_y: bool,
    looks: HouseLooks,
    overhang: float = 0.45,
) -> list[MeshPart]:
    """Return the gable walls and two roof slabs over the rectangle low … high, with the ridge along y or x."""
    thick = 0.16
    (x0, y0), (x1, y1) = low, high
    if not along_y:
        turned = gable((y0, -x1), (y1, -x0), eave, pitch, True, looks, overhang)
        return [g.transformed(p, yaw=np.pi / 2) for p in turned]
    middle, half = (x0 + x1) / 2, (x1 - x0) / 2
    ridge = eave + pitch * half
    solids = [g.profile([(x0, eave), (x1, eave), (middle, ridge)], y0, y1, *looks.wall)]
    drop = pitch * overhang
    for end in (x0 - overhang, x1 + overhang):
        ring = [(middle, ridge), (middle, ridge + thick), (end, eave - drop + thick), (end, eave - drop)]
        solids.append(g.profile(ring, y0 - overhang, y1 + overhang, *looks.roof))
        # fascia board under the eave
        near, far = sorted((end + np.sign(end - middle) * 0.03, end - np.sign(end - middle) * 0.05))
        board = (near, y0 - overhang + 0.02, eave - drop - 0.10), (far, y1 + overhang - 0.02, eave - drop + 0.12)
        solids.append(g.box(*board, looks.trim))
    return solids


def hip(
    low: tuple[float, float], high: tuple[float, float], eave: float, pitch: float, looks: HouseLooks
) -> list[MeshPart]:
    """Return a roof that slopes on all four sides of the rectangle low … high, with its ridge along the longer side."""
    overhang, thick = 0.45, 0.16
    (x0, y0), (x1, y1) = (low[0] - overhang, low[1] - overhang), (high[0] + overhang, high[1] + overhang)
    half = min(x1 - x0, y1 - y0) / 2
    z = eave - pitch * overhang + thick
    top = z + pitch * half
    if x1 - x0 < y1 - y0:
        a, b = ((x0 + x1) / 2, y0 + half, top), ((x0 + x1) / 2, y1 - half, top)
        ridge = [a, a, b, b]
    else:
        a, b = (x0 + half, (y0 + y1) / 2, top), (x1 - half, (y0 + y1) / 2, top)
        ridge = [a, b, b, a]
    return [
        g.box((x0, y0, z - thick - 0.06), (x1, y1, z), looks.trim),
        g.hull([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], ridge, *looks.roof),
    ]


def dormers(plan: HousePlan, eave: float, looks: HouseLooks) -> list[MeshPart]:
    """Return gabled dormers on the front slope, each with its window."""
    solids: list[MeshPart] = []
    front, run = plan.depth / 2 - 1.1, 1.5 / plan.pitch
    base = eave + plan.pitch * 1.1 + 0.1
    for y in np.linspace(-0.25, 0.25, plan.dormers) * plan.width if plan.dormers > 1 else (0.0,):
        low, high = (front - run, float(y) - 0.7), (front, float(y) + 0.7)
        solids.append(g.box((*low, base - 0.3), (*high, base + 1.15), *looks.wall))
        solids += gable(low, high, base + 1.15, 0.6, False, looks, 0.2)
        solids += window((front, float(y)), base + 0.2, 0.8, 0.85, "+x", looks.trim)
    return solids


def on_roof(plan: HousePlan, eave: float) -> list[MeshPart]:
    """Return a vent on the rear slope of a gabled roof, and solar panels or skylights on its front slope.

    Empty for a hipped roof, or if a gable is at the front.
    """
    if plan.hipped or plan.gable_front:
        return []
    front, rise = plan.depth / 2, plan.pitch
    top = 0.19  # m, height of the roof's upper side above the line of the eave

    def slab(x: tuple[float, float], y: tuple[float, float], thick: float, look: Material) -> MeshPart:
        ring = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        foot = [(a, b, eave + rise * (front - abs(a)) + top) for a, b in ring]
        return g.hull(foot, [(a, b, c + thick) for a, b, c in foot], look)

    side = 1.0 if plan.garage > 0 else -1.0
    vent = eave + rise * (front - 1.6)
    solids = [g.rod((-1.6, side * 1.8, vent), (-1.6, side * 1.8, vent + 0.75), (0.06, 0.06), materials.STEEL, 8)]
    if plan.on_roof == "panels":
        for k in range(4):
            y = -plan.width * 0.32 + 1.15 * k
            solids.append(slab((1.0, 2.7), (y, y + 1.08), 0.06, PANEL))
    elif plan.on_roof == "skylights":
        for y in (-plan.width * 0.22, plan.width * 0.22):
            solids.append(slab((1.5, 2.6), (y - 0.45, y + 0.45), 0.05, materials.TRIM))
            solids.append(slab((1.58, 2.52), (y - 0.37, y + 0.37), 0.07, materials.GLASS))
    return solids
