"""Suburban houses: walls of boards, brick or plaster, gabled or hipped roofs, windows, a porch, a garage."""

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.house_fronts import FOOTING_M, FOUNDATION_M, door, porch, window
from episodes.maps.assets.house_plans import GARAGE_DOORS, SHUTTERS, HousePlan, door_y
from episodes.maps.assets.house_roofs import dormers, gable, hip, on_roof
from episodes.maps.assets.house_surfaces import HouseLooks, looks_of
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

STOREY_M = 2.7


def _garage(plan: HousePlan, looks: HouseLooks) -> list[MeshPart]:
    """Return the garage wing: a lower block whose door stands at ground level."""
    side = float(plan.garage)
    y0, y1 = sorted((side * plan.width / 2, side * (plan.width / 2 + plan.garage_width)))
    x0, x1, eave = plan.depth / 2 - 6.3, plan.depth / 2 + 0.5, 2.55
    solids = [g.box((x0, y0, FOOTING_M), (x1, y1, eave), *looks.wall)]
    if plan.hipped:
        solids += hip((x0, y0), (x1, y1), eave, 0.5, looks)
    else:
        solids += gable((x0, y0), (x1, y1), eave, 0.5, False, looks)
    half, middle = plan.garage_width / 2 - 0.6, (y0 + y1) / 2
    color = materials.linear(GARAGE_DOORS[plan.garage_door])
    door_look = surface("garage_door" if plan.garage_style == "panels" else f"garage_{plan.garage_style}", color, 0.05)
    x = x1 + 0.03
    solids.append(g.box((x1 - 0.02, middle - half - 0.12, 0.0), (x1 + 0.02, middle + half + 0.12, 2.32), looks.trim))
    solids.append(g.panel(x, (middle - half, middle + half), (0.02, 2.2), door_look))
    solids.append(g.box((x1, middle - 0.09, 2.36), (x1 + 0.14, middle + 0.09, 2.52), materials.STEEL))
    return solids


def _windows(plan: HousePlan, entrance: float, trim: Material) -> list[MeshPart]:
    """Return the windows of all walls that the garage does not cover."""
    front, half = plan.depth / 2, plan.width / 2
    solids: list[MeshPart] = []
    shutter = None if plan.shutters == "none" else materials.plain(f"shutter-{plan.shutters}", SHUTTERS[plan.shutters])
    panes = (materials.WINDOW, surface("curtains", specular=0.6), surface("blind", specular=0.6))
    drawn = round(plan.width * 7.0)

    def add(centre: tuple[float, float], sill: float, width: float, height: float, face: str, shut: bool) -> None:
        nonlocal drawn
        drawn += 1
        pane = panes[(0, 1, 0, 2, 1)[drawn * 3 % 5]]
        solids.extend(window(centre, sill, width, height, face, trim, plan.window, pane, shutter if shut else None))

    for storey in range(plan.storeys):
        sill = FOUNDATION_M + storey * STOREY_M + 0.85
        for y in np.linspace(-half + 1.6, half - 1.6, 3 if plan.width < 11.5 else 4):
            if storey > 0 or abs(y - entrance) > 1.75:
                add((front, y), sill, 1.5 if storey == 0 else 1.15, 1.35, "+x", True)
            add((-front, y), sill, 1.2, 1.3, "-x", False)
        for side, face in ((1, "+y"), (-1, "-y")):
            if storey == 0 and plan.garage == side:
                continue
            for x in (-front + 2.0, front - 2.2):
                add((x, side * half), sill, 1.1, 1.3, face, False)
    return solids


def house(plan: HousePlan) -> Mesh:
    """Return the mesh of a house. Its origin is on the ground under the middle of the main block."""
    looks = looks_of(plan)
    front, half = plan.depth / 2, plan.width / 2
    eave = FOUNDATION_M + plan.storeys * STOREY_M
    entrance = door_y(plan)
    stone = surface("concrete")
    middle = FOUNDATION_M + STOREY_M if plan.band and plan.storeys == 2 else FOUNDATION_M
    solids: list[MeshPart] = [
        g.box((-front - 0.03, -half - 0.03, FOOTING_M), (front + 0.03, half + 0.03, FOUNDATION_M), stone, 1.5),
        g.box((-front, -half, middle), (front, half, eave), *looks.wall),
        *door(plan, front, entrance, FOUNDATION_M, looks.trim),
        *_windows(plan, entrance, looks.trim),
    ]
    if plan.hipped:
        solids += hip((-front, -half), (front, half), eave, plan.pitch, looks)
    else:
        solids += gable((-front, -half), (front, half), eave, plan.pitch, not plan.gable_front, looks)
    if plan.dormers:
        solids += dormers(plan, eave, looks)
    if middle > FOUNDATION_M:
        solids.append(g.box((-front, -half, FOUNDATION_M), (front, half, middle), *looks.bricks))
    if not plan.brick:
        for x in (-front, front):
            for y in (-half, half):
                solids.append(g.box((x - 0.08, y - 0.08, FOUNDATION_M), (x + 0.08, y + 0.08, eave), looks.trim))
    if plan.gable_front and not plan.hipped:
        solids += window((front, 0.0), eave + 0.5, 0.9, 0.9, "+x", looks.trim, plan.window)
    if plan.garage:
        solids += _garage(plan, looks)
    if plan.porch > 0.0:
        solids += porch(plan, front, entrance, looks)
    else:
        solids.append(
            g.box((front, entrance - 0.8, FOOTING_M), (front + 1.0, entrance + 0.8, FOUNDATION_M), stone, 1.5)
        )
    solids += on_roof(plan, eave)
    if plan.chimney:
        ridge = eave + plan.pitch * (min(front, half) if plan.hipped else half if plan.gable_front else front)
        x, y = (-0.9, -plan.garage * half * 0.6) if not plan.gable_front else (-front * 0.4, 0.9)
        solids.append(g.box((x - 0.4, y - 0.5, eave - 0.5), (x + 0.4, y + 0.5, ridge + 0.75), *looks.bricks))
        solids.append(g.box((x - 0.48, y - 0.58, ridge + 0.70), (x + 0.48, y + 0.58, ridge + 0.82), stone))
        solids.append(g.rod((x, y, ridge + 0.8), (x, y, ridge + 1.15), (0.15, 0.13), materials.STEEL))
    return g.assemble(solids)
