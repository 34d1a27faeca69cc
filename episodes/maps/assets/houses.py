"""Builds suburban houses: walls of boards, brick or plaster, roofs with dormers and vents, a porch, a garage."""

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.house_plans import DOORS, GARAGE_DOORS, SHUTTERS, HousePlan, door_y
from episodes.maps.assets.house_surfaces import HouseLooks, looks_of
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material, Mesh

FOUNDATION_M = 0.35  # height of the floor above the ground
# normals of end faces that other parts hide: of level bars (SIDES) and of upright bars (ENDS)
SIDES, ENDS = ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
FOOTING_M = -0.9  # lower edge of the walls; below 0, because the ground may slope away from the house


def window(
    centre: tuple[float, float],
    sill: float,
    width: float,
    height: float,
    face: str,
    trim: Material,
    style: str = "sash",
    pane: Material = materials.WINDOW,
    shutter: Material | None = None,
) -> list[MeshPart]:
    """Return a framed window of a style of WINDOWS, with its middle at `centre` (x, y) and its pane from `sill` (m) up.

    The window faces `face` ('+x', '-x', '+y' or '-y').
    """
    half, top, bar = width / 2, sill + height, 0.075
    solids = [
        g.box((-0.02, -half - bar, sill - bar), (0.06, -half, top + bar), trim),
        g.box((-0.02, half, sill - bar), (0.06, half + bar, top + bar), trim),
        g.without(g.box((-0.02, -half, top), (0.06, half, top + bar), trim), *SIDES),
        g.box((-0.02, -half - 0.14, sill - bar), (0.11, half + 0.14, sill), trim),
        g.panel(0.02, (-half, half), (sill, top), pane),
    ]
    level = {"sash": (0.5,), "grid": (1 / 3, 2 / 3), "casement": (0.72,)}.get(style, ())
    upright = {"grid": (0.5,), "casement": (0.5,)}.get(style, (0.5,) if style == "sash" and width > 1.3 else ())
    for share in level:
        z = sill + share * height
        rail = g.box((-0.02, -half, z - 0.022), (0.035, half, z + 0.022), trim)
        solids.append(g.without(rail, *SIDES))
    for share in upright:
        y = -half + share * width
        post = g.box((-0.02, y - 0.025, sill), (0.036, y + 0.025, top), trim)
        solids.append(g.without(post, *ENDS))
    if shutter is not None:
        for y in (-half - bar - 0.34, half + bar):
            solids.append(g.box((-0.01, y, sill - bar), (0.045, y + 0.34, top + bar), shutter))
    # the faces against the wall are never seen
    solids = [g.without(p, (-1.0, 0.0, 0.0)) for p in solids]
    turn = {"+x": 0.0, "+y": np.pi / 2, "-x": np.pi, "-y": -np.pi / 2}[face]
    return [g.transformed(p, (*centre, 0.0), turn) for p in solids]


def door(plan: HousePlan, x: float, y: float, floor: float, trim: Material) -> list[MeshPart]:
    """Return a front door of a style of DOOR_STYLES with its frame, knob and panes."""
    leaf, glass = materials.plain(f"door-{plan.door}", DOORS[plan.door], 0.2), materials.WINDOW
    solids = [
        g.box((x - 0.05, y - 0.58, floor), (x + 0.05, y + 0.58, floor + 2.22), trim),
        g.box((x, y - 0.47, floor), (x + 0.07, y + 0.47, floor + 2.10), leaf),
        g.ball((x + 0.11, y - 0.38, floor + 1.0), (0.04, 0.04, 0.04), materials.CHROME, 1),
    ]
    if plan.door_style == "glazed":
        solids.append(g.box((x + 0.05, y - 0.33, floor + 0.35), (x + 0.085, y + 0.33, floor + 1.95), glass))
        solids.append(g.box((x + 0.05, y - 0.47, floor + 1.0), (x + 0.095, y + 0.47, floor + 1.12), leaf))
    elif plan.door_style == "planks":
        solids.append(g.box((x + 0.05, y - 0.14, floor + 1.45), (x + 0.085, y + 0.14, floor + 1.75), glass))
        solids += [g.box((x + 0.05, y - 0.40, z), (x + 0.08, y + 0.30, z + 0.05), materials.TRIM)
                   for z in (floor + 0.40, floor + 1.85)]  # fmt: skip
    else:
        solids.append(g.box((x + 0.05, y - 0.30, floor + 1.15), (x + 0.085, y + 0.30, floor + 1.90), glass))
        solids.append(g.box((x + 0.05, y - 0.30, floor + 0.25), (x + 0.082, y + 0.30, floor + 0.85), leaf))
    return solids


def porch(plan: HousePlan, front: float, y: float, looks: HouseLooks) -> list[MeshPart]:
    """Return a deck, steps, posts, railings and a lean-to roof in front of the wall at x = `front`, centred on `y`."""
    reach, half, high = 1.9, plan.porch / 2, FOUNDATION_M + 2.45
    stone, trim, outer = surface("concrete"), looks.trim, front + reach
    solids = [
        g.box((front, y - half, FOOTING_M), (front + reach, y + half, FOUNDATION_M), stone, 1.5),
        g.box((front + reach, y - 0.8, FOOTING_M), (front + reach + 0.32, y + 0.8, FOUNDATION_M / 2), stone, 1.5),
        g.box((front, y - half - 0.1, high), (front + reach + 0.1, y + half + 0.1, high + 0.16), trim),
    ]
    ring = [
        (front, high + 0.16),
        (front + reach + 0.35, high + 0.16),
        (front + reach + 0.35, high + 0.26),
        (front, high + 0.85),
    ]
    solids.append(g.profile(ring, y - half - 0.3, y + half + 0.3, *looks.roof))
    for side in (-1.0, 1.0):
        py = y + side * (half - 0.12)
        if plan.posts == "stout":
            block = (outer - 0.32, py - 0.19, FOUNDATION_M), (outer, py + 0.17, FOUNDATION_M + 0.9)
            solids.append(g.box(*block, *looks.bricks))
            mx, my = outer - 0.16, py - 0.01  # the middle of the post
            (x0, y0), (x1, y1) = (outer - 0.26 - mx, py - 0.16 - my), (outer - mx, py + 0.14 - my)
            ends = [((mx + k * x0, my + k * y0), (mx + k * x1, my + k * y1)) for k in (0.85, 0.6)]
            solids.append(g.frustum(ends[0], ends[1], (FOUNDATION_M + 0.9, high), trim))
        elif plan.posts == "round":
            solids.append(g.rod((outer - 0.12, py, FOUNDATION_M), (outer - 0.12, py, high), (0.11, 0.09), trim, 12))
        else:
            solids.append(g.box((outer - 0.2, py - 0.08, FOUNDATION_M), (outer - 0.04, py + 0.08, high), trim))
        a, b = sorted((y + side * 0.85, py))
        if b - a > 0.3:
            solids += _railing(plan, outer, a, b, looks)
    return solids


def _railing(plan: HousePlan, outer: float, a: float, b: float, looks: HouseLooks) -> list[MeshPart]:
    """Return the railing of a porch from y = a to b."""
    if plan.railing == "none":
        return []
    solids = [g.box((outer - 0.15, a, FOUNDATION_M + 0.85), (outer - 0.09, b, FOUNDATION_M + 0.93), looks.trim)]
    if plan.railing == "solid":
        return [*solids, g.box((outer - 0.14, a, FOUNDATION_M), (outer - 0.10, b, FOUNDATION_M + 0.85), *looks.wall)]
    post = g.box((outer - 0.135, -0.02, FOUNDATION_M), (outer - 0.105, 0.02, FOUNDATION_M + 0.85), looks.trim)
    baluster = g.without(post, *ENDS)
    return solids + [g.transformed(baluster, (0.0, float(k), 0.0)) for k in np.arange(a + 0.1, b, 0.22)]


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
