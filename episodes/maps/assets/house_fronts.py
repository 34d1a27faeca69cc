"""The street side of a house: windows, front door, porch."""

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.house_plans import DOORS, HousePlan
from episodes.maps.assets.house_surfaces import HouseLooks
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Material

FOUNDATION_M = 0.35  # height of the floor above the ground
SIDES, ENDS = ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0))  # directions of hidden faces
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
    # leave out the faces against the wall, which are never seen
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
            low = [(outer - 0.26, py - 0.16), (outer, py - 0.16), (outer, py + 0.14), (outer - 0.26, py + 0.14)]
            block = (outer - 0.32, py - 0.19, FOUNDATION_M), (outer, py + 0.17, FOUNDATION_M + 0.9)
            solids.append(g.box(*block, *looks.bricks))
            middle = (outer - 0.16, py - 0.01)
            foot = [
                (middle[0] + 0.85 * (a - middle[0]), middle[1] + 0.85 * (b - middle[1]), FOUNDATION_M + 0.9)
                for a, b in low
            ]
            solids.append(g.hull(foot, [(middle[0] + 0.6 * (a - middle[0]), middle[1] + 0.6 * (b - middle[1]), high)
                                        for a, b in low], trim))  # fmt: skip
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
