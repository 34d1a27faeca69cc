"""Builds campus halls: walls with windows set back between piers, an entrance with steps and a name, and a roof.

A hall's front faces forward (+x) and its width runs along y. The origin is on the ground under the hall's middle.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.materials import linear, surface
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Array, Material, Mesh

FLOOR_M = 0.45  # height of the ground floor above the ground: three steps
FOOT_M = 0.8  # walls reach this far below the ground, because the ground slopes
TINTS = {"sand": (222, 204, 172), "pale": (226, 226, 222), "ochre": (206, 180, 136), "slate": (164, 172, 178)}
DARK_FRAME, PALE_FRAME = (52, 54, 56), (228, 226, 218)


@dataclass(frozen=True, slots=True)
class HallPlan:
    """Dimensions and features of one hall, m."""

    name: str  # shown in capitals over the door
    style: str  # 'brick', 'ribbon', 'columns', 'glass'
    width: float  # along y
    depth: float
    storeys: int
    tint: str = "pale"  # in TINTS, for stone and panels; brick has its own colour
    storey_m: float = 3.6
    bay_m: float = 3.4  # width of one window with its pier

    @property
    def top(self) -> float:
        """Return the height (m) of the eaves."""
        return FLOOR_M + self.storeys * self.storey_m


def hall(plan: HallPlan) -> Mesh:
    """Return the mesh of a hall."""
    wall, tile = _wall(plan)
    half_d, half_w = plan.depth / 2, plan.width / 2
    solids = [g.box((-half_d, -half_w, -FOOT_M), (half_d, half_w, plan.top), wall, tile)]
    faces = ((half_d, plan.width, 0.0), (half_w, plan.depth, 0.5), (half_d, plan.width, 1.0), (half_w, plan.depth, 1.5))
    facade = {"brick": _brick_face, "ribbon": _ribbon_face, "columns": _stone_face, "glass": _glass_face}[plan.style]
    for k, (out, width, turns) in enumerate(faces):
        panels = facade(plan, width, k == 0)
        solids += [g.transformed(g.transformed(p, (out, 0.0, 0.0)), yaw=turns * np.pi) for p in panels]
    solids += [g.transformed(p, (half_d, 0.0, 0.0)) for p in _entrance(plan)]
    solids += _portico(plan) if plan.style == "columns" else []
    return g.assemble([*solids, *_roof(plan)])


def reach(plan: HallPlan) -> tuple[float, float, float]:
    """Return how far (m) a hall with its steps reaches forward, backward and to either side of its origin."""
    return plan.depth / 2 + (7.4 if plan.style == "columns" else 3.4), plan.depth / 2 + 0.5, plan.width / 2 + 0.5


def _stone(plan: HallPlan) -> Material:
    return surface("ashlar", linear(TINTS[plan.tint]))


def _wall(plan: HallPlan) -> tuple[Material, float]:
    """Return the walls' material and the metres per repeat of its texture."""
    if plan.style == "brick":
        return surface("brick"), 0.6
    if plan.style == "ribbon":
        return surface("panels", linear(TINTS[plan.tint])), 3.6
    if plan.style == "glass":
        return surface("curtain", specular=0.6), 3.6
    return _stone(plan), 2.4


def _bays(plan: HallPlan, width: float) -> Array:
    """Return the edges (N + 1,) m of the N bays of a wall; the solid corner at either end is left out."""
    half = width / 2 - 0.9
    count = max(2, round(2 * half / plan.bay_m))
    return np.linspace(-half, half, count + 1)


def _has_window(y: float, storey: int, front: bool) -> bool:
    """Return whether a window fits at y. The entrance takes up the middle of the front's ground storey."""
    return not (front and storey == 0 and abs(y) < 3.4)


def _foot_of(plan: HallPlan, y: float, front: bool) -> float:
    """Return the height (m) of a pier's lower end at y; a pier at the doors begins above them."""
    return FLOOR_M + (plan.storey_m if front and abs(y) < 2.8 else 0.0)


def _band(
    y: tuple[float, float], z: tuple[float, float], out: float, look: Material, tile: float, door: bool
) -> list[MeshPart]:
    """Return a horizontal band that projects by `out` (m) from a wall; if `door`, it has a gap at the entrance."""
    ends = ((y[0], -2.3), (2.3, y[1])) if door else (y,)
    return [g.box((-0.1, a, z[0]), (out, b, z[1]), look, tile) for a, b in ends]


def _blind(column: int, storey: int) -> float:
    """Return the share of a window that its blind covers: one of three values, without a visible pattern."""
    return (0.0, 0.0, 0.28, 0.0, 0.55, 0.0, 0.28)[(column * 3 + storey * 5) % 7]


def _brick_face(plan: HallPlan, width: float, front: bool) -> list[MeshPart]:
    """Return a brick wall: projecting piers and bands of brick and stone, with windows set back behind them."""
    brick, stone = surface("brick"), surface("concrete", (0.98, 0.94, 0.86))
    edges, half = _bays(plan, width), width / 2
    solids = [g.box((-0.1, -half - 0.06, -FOOT_M), (0.34, half + 0.06, FLOOR_M), stone, 1.5)]
    solids += [g.box((-0.1, y - 0.42, _foot_of(plan, y, front)), (0.26, y + 0.42, plan.top), brick, 0.6) for y in edges]
    solids += [
        g.box((-0.1, min(a, b), FLOOR_M), (0.26, max(a, b), plan.top), brick, 0.6)
        for a, b in ((-half, edges[0]), (edges[-1], half))
    ]
    for storey in range(plan.storeys):
        floor = FLOOR_M + storey * plan.storey_m
        if storey:
            solids.append(g.box((-0.1, -half - 0.02, floor - 0.12), (0.32, half + 0.02, floor + 0.14), stone, 1.5))
        for k, y in enumerate((edges[:-1] + edges[1:]) / 2):
            if not _has_window(y, storey, front):
                continue
            w, sill, head = 0.88, floor + 0.85, floor + plan.storey_m - 0.55
            solids.append(
                g.panel(0.03, (y - w, y + w), (sill, head), materials.window(PALE_FRAME, 2, _blind(k, storey)))
            )
            solids.append(g.box((0.0, y - w - 0.1, sill - 0.14), (0.2, y + w + 0.1, sill), stone))
            solids.append(g.box((0.0, y - w - 0.14, head), (0.12, y + w + 0.14, head + 0.26), stone))
    solids.append(g.box((-0.1, -half - 0.08, plan.top), (0.4, half + 0.08, plan.top + 0.4), stone, 1.5))
    return solids


def _ribbon_face(plan: HallPlan, width: float, front: bool) -> list[MeshPart]:
    """Return a concrete wall: bands of glass between spandrels, divided by vertical fins."""
    panel, fin = surface("panels", linear(TINTS[plan.tint])), materials.plain("fin", (210, 208, 200))
    edges, half = _bays(plan, width), width / 2
    solids = []
    for storey in range(plan.storeys):
        floor = FLOOR_M + storey * plan.storey_m
        sill, head = floor + 1.0, floor + plan.storey_m - 0.5
        low = -FOOT_M if storey == 0 else floor - 0.5
        solids += _band((-half - 0.02, half + 0.02), (low, sill), 0.22, panel, 3.6, front and storey == 0)
        for k, (a, b) in enumerate(itertools.pairwise(edges)):
            if _has_window((a + b) / 2, storey, front):
                solids.append(g.panel(0.03, (a, b), (sill, head), materials.window(DARK_FRAME, 3, _blind(k, storey))))
    solids.append(g.box((-0.1, -half - 0.02, plan.top - 0.5), (0.22, half + 0.02, plan.top + 0.7), panel, 3.6))
    solids += [
        g.box((-0.1, a, FLOOR_M), (0.22, b, plan.top), panel, 3.6) for a, b in ((-half, edges[0]), (edges[-1], half))
    ]
    fins = [y for y in edges if not (front and abs(y) < 3.4)]
    solids += [g.box((0.0, y - 0.09, FLOOR_M + 1.0), (0.5, y + 0.09, plan.top + 0.2), fin) for y in fins]
    if front:
        solids += [
            g.box((0.0, y - 0.09, FLOOR_M + plan.storey_m), (0.5, y + 0.09, plan.top + 0.2), fin)
            for y in edges
            if abs(y) < 3.4
        ]
    return solids


def _stone_face(plan: HallPlan, width: float, front: bool) -> list[MeshPart]:
    """Return a wall of dressed stone: flat pilasters, tall windows with hoods, a heavy cornice."""
    stone = _stone(plan)
    edges, half = _bays(plan, width), width / 2
    solids = _band((-half - 0.1, half + 0.1), (-FOOT_M, FLOOR_M + 0.5), 0.4, stone, 2.4, front)
    for y in edges:
        solids.append(g.box((-0.1, y - 0.36, _foot_of(plan, y, front)), (0.3, y + 0.36, plan.top), stone, 2.4))
        solids.append(g.box((-0.1, y - 0.46, plan.top - 0.5), (0.38, y + 0.46, plan.top - 0.15), stone, 2.4))
    for storey in range(plan.storeys):
        floor = FLOOR_M + storey * plan.storey_m
        for k, y in enumerate((edges[:-1] + edges[1:]) / 2):
            if not _has_window(y, storey, front):
                continue
            w, sill, head = 0.75, floor + 0.75, floor + plan.storey_m - 0.6
            solids.append(
                g.panel(0.03, (y - w, y + w), (sill, head), materials.window(DARK_FRAME, 2, _blind(k, storey) / 2))
            )
            solids.append(g.box((0.0, y - w - 0.12, sill - 0.16), (0.22, y + w + 0.12, sill), stone, 2.4))
            hood = [(0.0, head), (0.26, head), (0.26, head + 0.12), (0.0, head + 0.3)]
            solids.append(g.profile(hood, y - w - 0.2, y + w + 0.2, stone, 2.4))
    solids.append(g.box((-0.1, -half - 0.2, plan.top - 0.15), (0.62, half + 0.2, plan.top + 0.3), stone, 2.4))
    solids.append(g.box((-0.3, -half - 0.05, plan.top + 0.3), (0.25, half + 0.05, plan.top + 1.1), stone, 2.4))
    return solids


def _glass_face(plan: HallPlan, width: float, front: bool) -> list[MeshPart]:
    """Return a glass wall with the floor slabs as bands and fins in front of it."""
    band, fin = materials.plain("slab-band", (214, 214, 208), 0.1), materials.plain("glass-fin", (92, 98, 104), 0.4)
    half = width / 2
    solids = [g.box((-0.1, -half - 0.1, -FOOT_M), (0.3, half + 0.1, FLOOR_M), surface("concrete"), 1.5)]
    for storey in range(1, plan.storeys + 1):
        z = FLOOR_M + storey * plan.storey_m
        solids.append(g.box((-0.1, -half - 0.2, z - 0.3), (0.45, half + 0.2, z), band))
    for y in np.linspace(-half, half, max(3, round(width / 2.4) + 1)):
        solids.append(g.box((-0.1, y - 0.05, _foot_of(plan, y, front)), (0.36, y + 0.05, plan.top), fin))
    solids.append(g.box((-0.1, -half - 0.3, plan.top), (1.1, half + 0.3, plan.top + 0.35), band))
    return solids


def _steps(front: float, half: float, count: int = 3) -> list[MeshPart]:
    """Return a landing and steps down to the ground, forward of x = front."""
    stone, rise = surface("concrete", (0.9, 0.88, 0.84)), FLOOR_M / count
    steps = [g.box((front - 0.1, -half, -FOOT_M), (front + 1.7, half, FLOOR_M), stone, 1.5)]
    for k in range(1, count):
        out, up = front + 1.7 + 0.36 * k, FLOOR_M - rise * k
        steps.append(g.box((front, -half - 0.36 * k, -FOOT_M), (out, half + 0.36 * k, up), stone, 1.5))
    return steps


def _entrance(plan: HallPlan) -> list[MeshPart]:
    """Return doors with their surround and the hall's name; add steps and a canopy unless the style is 'columns'.

    The wall is at x = 0.
    """
    floor, pale = FLOOR_M, surface("concrete", (0.98, 0.94, 0.86))
    door = surface("doors", specular=0.4)
    high = floor + plan.storey_m
    out = 0.42
    solids = [] if plan.style == "columns" else _steps(0.0, 3.0)
    solids += [
        g.box((0.0, -3.1, floor), (out, -2.2, high), pale, 1.5),
        g.box((0.0, 2.2, floor), (out, 3.1, high), pale, 1.5),
        g.box((0.0, -3.1, floor + 2.6), (out, 3.1, high), pale, 1.5),
        g.box((0.0, -0.18, floor), (out * 0.7, 0.18, floor + 2.6), pale, 1.5),
        g.panel(0.06, (-2.2, -0.18), (floor, floor + 2.6), door),
        g.panel(0.06, (0.18, 2.2), (floor, floor + 2.6), door),
    ]
    if plan.style != "columns":
        solids.append(
            g.box((0.0, -3.3, high - 0.95), (1.9, 3.3, high - 0.75), materials.plain("canopy", (76, 80, 84), 0.2))
        )
        for y in (-3.1, 3.1):
            solids.append(g.rod((1.7, y, floor), (1.7, y, high - 0.95), (0.06, 0.06), materials.STEEL, 8))
    name = materials.lettered(plan.name)
    assert name.texture is not None
    wide = 0.9 * name.texture.shape[1] / name.texture.shape[0] / 2
    out_x, low = (6.06, plan.top - 2.32) if plan.style == "columns" else (0.56, high + 0.1)
    solids.append(
        g.box(
            (0.0 if out_x < 1 else out_x - 0.2, -wide - 0.1, low - 0.08), (out_x - 0.02, wide + 0.1, low + 0.98), pale
        )
    )
    solids.append(g.panel(out_x, (-wide, wide), (low, low + 0.9), name))
    return solids


def _portico(plan: HallPlan) -> list[MeshPart]:
    """Return six columns on a broad stair, an entablature and a pediment in front of the hall."""
    stone, front, half = _stone(plan), plan.depth / 2, 8.2
    beam = plan.top - 2.6
    solids = [g.box((front, -half - 0.6, -FOOT_M), (front + 6.0, half + 0.6, FLOOR_M), stone, 2.4)]
    for k in range(1, 3):
        out = front + 6.0 + 0.45 * k
        solids.append(g.box((front, -half - 0.6, -FOOT_M), (out, half + 0.6, FLOOR_M * (1 - k / 3)), stone, 2.4))
    shaft = [(0.0, FLOOR_M), (0.66, FLOOR_M), (0.66, FLOOR_M + 0.22), (0.52, FLOOR_M + 0.34), (0.50, FLOOR_M + 2.5)]
    shaft += [(0.42, beam - 0.5), (0.44, beam - 0.45), (0.60, beam - 0.18), (0.60, beam)]
    column = g.lathe(shaft, surface("panels", linear(TINTS[plan.tint])), 18, 3.6)
    solids += [g.transformed(column, (front + 5.1, y, 0.0)) for y in np.linspace(-half + 0.5, half - 0.5, 6)]
    solids.append(g.box((front, -half - 0.4, beam), (front + 5.85, half + 0.4, plan.top - 1.1), stone, 2.4))
    solids.append(g.box((front, -half - 0.8, plan.top - 1.1), (front + 6.2, half + 0.8, plan.top - 0.7), stone, 2.4))
    gable = [(-half - 0.8, plan.top - 0.7), (half + 0.8, plan.top - 0.7), (0.0, plan.top + 2.4)]
    # the quarter turn puts the profile's x along the portico's width
    return [*solids, g.transformed(g.profile(gable, -front - 6.1, -front, stone, 2.4), yaw=np.pi / 2)]


def _roof(plan: HallPlan) -> list[MeshPart]:
    """Return the parts above the eaves: a hipped roof, or a flat deck with plant rooms."""
    d, w, top = plan.depth / 2, plan.width / 2, plan.top
    plant, deck = materials.plain("roof-plant", (132, 136, 138), 0.2), materials.plain("roof-deck", (120, 118, 114))
    if plan.style in ("brick", "columns"):
        tiles = surface("shingles", linear((96, 100, 106) if plan.style == "brick" else (104, 128, 118)))
        base, rise = top + (0.3 if plan.style == "brick" else 0.8), 0.42 * d
        low, high = ((-d - 0.2, -w - 0.2), (d + 0.2, w + 0.2)), ((-0.3, -w + d), (0.3, w - d))
        roof = [g.frustum(low, high, (base, base + rise), tiles, 1.6)]
        if plan.style == "brick":
            roof += [
                g.box((-1.0, y - 0.5, base), (0.2, y + 0.5, base + rise + 1.1), surface("brick"), 0.6)
                for y in (-w * 0.55, w * 0.55)
            ]
        return roof
    units = [((-d * 0.5, -w * 0.55), (d * 0.2, -w * 0.15), 2.2), ((-d * 0.4, w * 0.25), (d * 0.1, w * 0.5), 1.6)]
    roof_boxes = [g.box((-d + 0.2, -w + 0.2, top), (d - 0.2, w - 0.2, top + 0.1), deck)]
    return roof_boxes + [g.box((*a, top), (*b, top + h), plant) for a, b, h in units]
