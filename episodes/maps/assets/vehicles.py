"""Builds meshes of cars: a lofted body with wheel arches, a glazed cabin, wheels, lamps, mirrors and number plates."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import lettering, materials
from episodes.maps.geometry import MeshPart
from episodes.maps.scene import Array, Material, Mesh

DIGIT_M = 0.10  # height of a plate's characters (paper, appendix "Maps and Episodes")


@dataclass(frozen=True, slots=True)
class CarShape:
    """Dimensions of a car, m: x is forward of the middle, heights are above the road."""

    length: float
    width: float  # without mirrors
    wheelbase: float
    wheel_radius: float
    clearance: float
    deck: tuple[tuple[float, float], ...]  # (x, height) of the body's upper line from tail to nose, without cabin
    cabin_low: tuple[float, float]  # x of the rear and front glass at the belt
    cabin_high: tuple[float, float]  # x of the rear and front edge of the roof
    belt: float  # height of the lower edge of the windows
    roof: float
    pillars: tuple[float, ...]  # x of the upright pillars between the side windows
    side_glass: tuple[float, float]  # x range of the side windows at the belt; the rear sides of a van have none
    bed: tuple[float, float] | None = None  # x range of a pickup's load bed
    rails: bool = False  # on the roof
    cladding: bool = False  # dark strips along the sills and around the wheel arches


@dataclass(frozen=True, slots=True)
class Trim:
    """Features by which cars of one shape differ."""

    shade: int | None = None  # index into the paint's SHADES, modulo their number; None: the paint itself
    spokes: int = 5  # of a wheel, 0 for a hub cap
    rim: str = "silver"  # in RIMS
    grille: str = "bars"  # or 'mesh', 'slim'
    lamps: str = "square"  # or 'slim', 'round'
    roof: str = "painted"  # or 'black', 'glass'
    has_strip: bool = False  # dark, along the doors
    rise_m: float = 0.20  # rise of the underside at the ends


PLAIN = Trim()
RIMS = {"silver": materials.RIM, "dark": materials.plain("rim-dark", (66, 68, 72), 0.5), "grey": materials.STEEL}


def trim_of(number: int) -> Trim:
    """Return the trim of a parked car. Consecutive numbers give different trims."""
    return Trim(
        shade=number + number // 3,
        spokes=(5, 0, 10, 7, 5, 0, 6)[number % 7],
        rim=("silver", "silver", "dark", "grey", "dark")[number % 5],
        grille=("bars", "mesh", "slim")[number % 3],
        lamps=("square", "slim", "round", "slim")[number % 4],
        roof=("painted", "painted", "black", "painted", "glass")[number % 5],
        has_strip=number % 3 == 1,
        rise_m=0.12,
    )


SHAPES: dict[str, CarShape] = {
    "suv": CarShape(
        4.70, 1.90, 2.75, 0.37, 0.24,
        ((-2.35, 0.98), (-2.20, 1.08), (-0.5, 1.09), (0.95, 1.08), (1.75, 1.02), (2.20, 0.93), (2.35, 0.80)),
        (-2.22, 0.98), (-1.90, 0.28), 1.07, 1.72, (-1.28, -0.22), (-2.0, 0.85), rails=True, cladding=True,
    ),
    "sedan": CarShape(
        4.70, 1.82, 2.75, 0.33, 0.17,
        ((-2.35, 0.86), (-2.22, 1.0), (-1.6, 1.02), (0.0, 0.96), (0.95, 0.94), (1.8, 0.84), (2.22, 0.72), (2.35, 0.6)),
        (-1.72, 1.02), (-0.95, 0.18), 0.95, 1.45, (-0.82, -0.12), (-1.45, 0.80),
    ),
    "estate": CarShape(
        4.70, 1.82, 2.75, 0.33, 0.17,
        ((-2.35, 0.86), (-2.24, 0.98), (-1.6, 0.99), (0.0, 0.96), (0.95, 0.94), (1.8, 0.84), (2.22, 0.72), (2.35, 0.6)),
        (-2.24, 1.02), (-1.88, 0.18), 0.95, 1.46, (-0.92, -0.12), (-2.02, 0.80), rails=True,
    ),
    "hatchback": CarShape(
        4.05, 1.76, 2.55, 0.32, 0.17,
        ((-2.02, 0.84), (-1.92, 0.98), (-0.6, 0.98), (0.85, 0.96), (1.50, 0.88), (1.88, 0.76), (2.02, 0.62)),
        (-1.93, 0.95), (-1.45, 0.18), 0.97, 1.48, (-0.98, -0.12), (-1.70, 0.75),
    ),
    "pickup": CarShape(
        5.45, 1.98, 3.35, 0.40, 0.30,
        ((-2.72, 1.10), (-2.60, 1.14), (-0.6, 1.14), (1.15, 1.14), (2.05, 1.10), (2.55, 1.02), (2.72, 0.88)),
        (-0.62, 1.20), (-0.48, 0.50), 1.13, 1.84, (0.16,), (-0.55, 1.05), bed=(-2.58, -0.72), cladding=True,
    ),
    "van": CarShape(
        5.20, 2.00, 3.10, 0.35, 0.20,
        ((-2.60, 1.02), (-2.52, 1.10), (-0.5, 1.10), (1.55, 1.12), (2.15, 1.00), (2.48, 0.86), (2.60, 0.70)),
        (-2.58, 1.78), (-2.50, 0.95), 1.10, 2.12, (0.55,), (0.45, 1.55),
    ),
}  # fmt: skip


def plan_at(shape: CarShape, x: Array) -> Array:
    """Return the half width (m) of the body at x. The body narrows towards nose and tail."""
    reach = np.clip(np.abs(x) / (shape.length / 2), 0.0, 1.0)
    return shape.width / 2 * (1.0 - 0.10 * reach**5 - 0.06 * np.clip((reach - 0.93) / 0.07, 0, 1) ** 2)


def body(shape: CarShape, material: Material, rise_m: float = 0.20) -> list[MeshPart]:
    """Return the lower body, lofted along x. Its underside rises over the wheels and at the ends (`rise_m`)."""
    half, arch, axle = shape.length / 2, shape.wheel_radius * 1.20, shape.wheelbase / 2
    around = arch * np.cos(np.linspace(0.0, np.pi, 11))
    x = np.unique(
        np.round(
            np.concatenate(
                [np.linspace(-half, half, 15), axle + around, -axle + around, np.array([p[0] for p in shape.deck])]
                + [np.array([end * (half - d) for d in (0.0, 0.03, 0.10)]) for end in (-1, 1)]
            ),
            3,
        )
    )
    deck = np.array(shape.deck)
    top = np.interp(x, deck[:, 0], deck[:, 1])
    bottom = np.full_like(x, shape.clearance)
    bottom += rise_m * np.clip((np.abs(x) - half + 0.12) / 0.12, 0, 1) ** 2
    for centre in (-axle, axle):
        inside = np.abs(x - centre) < arch - 1e-6
        rise = np.sqrt(np.clip(arch**2 - (x - centre) ** 2, 0.0, None))
        bottom = np.where(inside, np.maximum(bottom, shape.wheel_radius + rise), bottom)
    bottom = np.minimum(bottom, top - 0.08)
    wide = plan_at(shape, x)
    tall = top - bottom
    # half cross-section from bottom to top: fractions of the half width and of the height
    section = [(0.0, 0.0), (0.93, 0.0), (0.985, 0.06), (1.0, 0.30), (1.0, 0.62), (0.985, 0.84), (0.94, 0.96)]
    section += [(0.84, 1.0), (0.42, 1.02), (0.0, 1.03)]
    ring = section + [(-a, b) for a, b in section[-2:0:-1]]
    points = np.stack([np.stack([x, wide * a, bottom + tall * b], axis=1) for a, b in [*ring, ring[0]]], axis=1)
    skin = [g.grid(points[::-1, 1:-1], material, crease_deg=42.0)]
    # the underside, which is also the roof of the wheel housings, is never painted
    skin += [g.grid(points[::-1, pair], materials.SHADOW) for pair in (slice(0, 2), slice(-2, None))]
    return [*skin, g.cap(points[0][:-1], material, faces_back=True), g.cap(points[-1][:-1], material)]


def _cabin_side(shape: CarShape, x: float, z: float) -> float:
    """Return the half width (m) of the cabin at x and height z. It narrows towards the roof and towards both ends."""
    up = (z - shape.belt) / (shape.roof - shape.belt)
    ends = plan_at(shape, np.array(shape.cabin_low)) / (shape.width / 2)
    taper = float(np.interp(x, shape.cabin_low, ends))
    return shape.width / 2 * taper * (0.945 - 0.145 * up)


def _edge(shape: CarShape, end: int, z: float) -> float:
    """Return x of the cabin's rear (0) or front (1) edge at height z."""
    up = (z - shape.belt) / (shape.roof - shape.belt)
    return shape.cabin_low[end] + (shape.cabin_high[end] - shape.cabin_low[end]) * up


def _cabin(shape: CarShape, material: Material, roof: str) -> list[MeshPart]:
    """Return the cabin: a shell with a curved roof, and glass 12 mm outside the shell."""
    levels = (shape.belt - 0.11, shape.roof - 0.09, shape.roof - 0.03, shape.roof)
    inset = (0.0, 0.0, 0.045, 0.16)

    def ring(z: float, inward: float) -> Array:
        rear, front = _edge(shape, 0, z) + inward, _edge(shape, 1, z) - inward
        behind, ahead = _cabin_side(shape, rear, z) - inward, _cabin_side(shape, front, z) - inward
        cut = 0.10 + 0.3 * inward
        right = [(rear + 0.02, -behind + cut, z), (rear + cut, -behind, z), (front - cut, -ahead, z)]
        right.append((front, -ahead + cut, z))
        return np.array(right + [(x, -y, z) for x, y, z in right[::-1]])

    rings = [ring(z, i) for z, i in zip(levels, inset, strict=True)]
    looks = (material, *2 * (materials.TRIM if roof == "black" else material,))
    solids = [
        g.hull(a, b, look, crease_deg=40.0) for (a, b), look in zip(itertools.pairwise(rings), looks, strict=True)
    ]
    front, rear = shape.cabin_high[1] - 0.35, max(shape.cabin_high[1] - 1.15, shape.cabin_high[0] + 0.35)
    if roof == "glass" and front - rear > 0.3:
        half, z = shape.width / 2 - 0.45, shape.roof + 0.006
        solids.append(g.quad([(rear, -half, z), (front, -half, z), (front, half, z), (rear, half, z)], materials.GLASS))
    low, high = shape.belt + 0.02, shape.roof - 0.10
    proud = 0.012
    # wind screen and rear window
    for end, sign in ((1, 1.0), (0, -1.0)):
        if end == 0 and shape.bed is None and shape.side_glass[0] > shape.cabin_low[0] + 1.0:
            solids += _rear_doors(shape)
            continue
        x0, x1 = _edge(shape, end, low), _edge(shape, end, high)
        y0, y1 = _cabin_side(shape, x0, low) - 0.13, _cabin_side(shape, x1, high) - 0.13
        x0, x1 = x0 + sign * proud, x1 + sign * proud
        pane = [(x0, -y0, low), (x0, y0, low), (x1, y1, high), (x1, -y1, high)]
        solids.append(g.quad(_facing(pane, (sign, 0.0, 0.3)), materials.GLASS))
    rear, front = shape.side_glass
    cuts = sorted([rear, *[p for p in shape.pillars if rear < p < front], front])
    for a, b in itertools.pairwise(cuts):
        top_a = max(a + 0.035, _edge(shape, 0, high) + 0.17) if a == rear else a + 0.035
        top_b = min(b - 0.035, _edge(shape, 1, high) - 0.15) if b == front else b - 0.035
        if top_b - top_a < 0.1:
            continue
        rim = [(a + 0.035, low), (b - 0.035, low), (top_b, high), (top_a, high)]
        for side in (1.0, -1.0):
            pane = [(x, side * (_cabin_side(shape, x, z) + proud), z) for x, z in rim]
            solids.append(g.quad(_facing(pane, (0.0, side, 0.2)), materials.GLASS))
    if shape.rails:
        for side in (-1.0, 1.0):
            x0, x1 = shape.cabin_high[0] + 0.25, shape.cabin_high[1] - 0.25
            y, z = side * (_cabin_side(shape, x0, shape.roof) - 0.12), shape.roof + 0.03
            solids.append(g.box((x0, y - 0.018, z), (x1, y + 0.018, z + 0.028), materials.TRIM))
            for x in (x0 + 0.06, (x0 + x1) / 2, x1 - 0.06):
                solids.append(g.box((x - 0.04, y - 0.015, z - 0.06), (x + 0.04, y + 0.015, z + 0.01), materials.TRIM))
    return solids


def _rear_doors(shape: CarShape) -> list[MeshPart]:
    """Return the split rear doors of a panel van, a window in each, and the rail of the sliding door on either side."""
    low, high, proud = shape.roof - 0.72, shape.roof - 0.26, 0.012
    solids = []
    for side in (1.0, -1.0):
        pane = []
        for z in (low, high):
            x = _edge(shape, 0, z) - proud
            wide = _cabin_side(shape, x, z) - 0.18
            pane += [(x, side * 0.07, z), (x, side * wide, z)]
        pane = [pane[0], pane[1], pane[3], pane[2]]
        solids.append(g.quad(_facing(pane, (-1.0, 0.0, 0.2)), materials.GLASS))
        rail = [(x, side * (_cabin_side(shape, x, z) + 0.01), z) for x, z in
                ((-2.2, low + 0.10), (0.4, low + 0.10), (0.4, low + 0.14), (-2.2, low + 0.14))]  # fmt: skip
        solids.append(g.quad(_facing(rail, (0.0, side, 0.2)), materials.SHADOW))
    seam = []
    for y, z in ((0.012, shape.belt), (-0.012, shape.belt), (-0.012, shape.roof - 0.1), (0.012, shape.roof - 0.1)):
        seam.append((_edge(shape, 0, z) - proud, y, z))
    solids.append(g.quad(_facing(seam, (-1.0, 0.0, 0.2)), materials.SHADOW))
    return solids


def _facing(points: list[tuple[float, float, float]], outward: tuple[float, float, float]) -> Array:
    """Return the four points in the order that makes their face point along `outward`."""
    p = np.array(points)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    return p if np.dot(normal, outward) > 0.0 else p[[1, 0, 3, 2]]


def wheel(radius: float, width: float, spokes: int = 5, rim: Material = materials.RIM) -> list[MeshPart]:
    """Return a wheel about the y axis through the origin, its rim on the +y side. 0 spokes: a hub cap."""
    half = width / 2
    outline = [
        (0.93 * radius, -half),
        (radius, -0.6 * half),
        (radius, 0.6 * half),
        (0.93 * radius, half),
        (0.70 * radius, half),
    ]
    dish = [(0.70 * radius, half), (0.66 * radius, 0.80 * half), (0.60 * radius, 0.45 * half), (0.0, 0.45 * half)]
    solids = [g.lathe(outline, materials.RUBBER, 20), g.lathe(dish[:2], rim, 14)]
    if spokes == 0:
        cap = [dish[1], (0.56 * radius, 0.92 * half), (0.30 * radius, 0.70 * half), (0.14 * radius, 0.95 * half)]
        return [about_y(p) for p in [*solids, g.lathe([*cap, (0.0, 0.95 * half)], rim, 14)]]
    solids.append(g.lathe(dish[1:], materials.TRIM, 14))
    inner, outer, root, thin = 0.04, 0.67 * radius, 0.45 * half, min(1.0, 5.5 / spokes)
    spoke = g.hull(
        [(inner, -0.045 * thin, root), (outer, -0.032 * thin, root), (outer, 0.032 * thin, root),
         (inner, 0.045 * thin, root)],
        [(inner, -0.038 * thin, 2 * root), (outer, -0.026 * thin, 0.8 * half), (outer, 0.026 * thin, 0.8 * half),
         (inner, 0.038 * thin, 2 * root)],
        rim,
    )  # fmt: skip
    solids += [g.transformed(spoke, yaw=2 * np.pi * k / spokes) for k in range(spokes)]
    solids.append(g.lathe([(0.075, 0.5 * half), (0.075, 0.95 * half), (0.0, 0.95 * half)], rim, 8))
    return [about_y(p) for p in solids]


def about_y(part: MeshPart) -> MeshPart:
    """Return a part rotated so that its z axis points along +y."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return replace(part, corners=part.corners @ turn, normals=part.normals @ turn)


def _wheels(shape: CarShape, trim: Trim) -> list[MeshPart]:
    """Return four wheels, their housings and the dark underbody."""
    solids = []
    wheel_solids = wheel(shape.wheel_radius, 0.23, trim.spokes, RIMS[trim.rim])
    for x in (-shape.wheelbase / 2, shape.wheelbase / 2):
        y = shape.width / 2 - 0.135
        left = [g.transformed(p, (x, y, shape.wheel_radius)) for p in wheel_solids]
        solids += left + [g.mirrored(p) for p in left]
    reach, inner = shape.length / 2 - 0.35, shape.width / 2 - 0.30
    solids.append(g.box((-reach, -inner, shape.clearance - 0.02), (reach, inner, shape.belt - 0.35), materials.SHADOW))
    return solids


def _lamps(shape: CarShape, trim: Trim, end: float, nose: float, tail: float, low: float) -> list[MeshPart]:
    """Return grille, bumpers and lamps; `end` is the half width at nose and tail."""
    half, mid = shape.length / 2, shape.clearance + 0.42 * (nose - shape.clearance)
    sill = nose - 0.16 if trim.grille == "slim" else mid + 0.02
    solids = [
        g.box((half - 0.05, -0.42 * end, sill), (half + 0.012, 0.42 * end, nose - 0.07), materials.TRIM),
        g.box((half - 0.06, -0.80 * end, low), (half + 0.018, 0.80 * end, low + 0.13), materials.TRIM),
        g.box((-half - 0.018, -0.86 * end, low), (-half + 0.06, 0.86 * end, low + 0.18), materials.TRIM),
    ]
    bars: dict[str, list[float]] = {"bars": np.linspace(mid + 0.06, nose - 0.11, 3).tolist(), "slim": [nose - 0.115]}
    for z in bars.get(trim.grille, []):
        solids.append(g.box((half, -0.40 * end, z - 0.008), (half + 0.02, 0.40 * end, z + 0.008), materials.CHROME))
    tall = min(0.36, tail - 0.12 - (shape.clearance + 0.38))
    inner = 0.62 if tall < 0.36 else 0.76
    if trim.lamps == "slim":
        tall, inner = min(tall, 0.16), 0.44
    if trim.lamps == "round":
        front = g.ball((half - 0.02, 0.74 * end, nose - 0.11), (0.045, 0.105, 0.085), materials.HEADLAMP, 1)
    else:
        foot = (half - 0.10, 0.50 * end, nose - (0.08 if trim.lamps == "slim" else 0.15))
        front = g.box(foot, (half + 0.022, 0.985 * end, nose - 0.03), materials.HEADLAMP)
    pair = [
        front,
        g.box((half - 0.05, 0.70 * end, low + 0.02), (half + 0.028, 0.86 * end, low + 0.08), materials.HEADLAMP),
        g.box((-half - 0.022, inner * end, tail - tall), (-half + 0.12, 0.99 * end, tail - 0.05), materials.TAIL_LAMP),
        g.box((-half - 0.026, inner * end, tail - tall), (-half, 0.99 * end, tail - tall + 0.05), materials.INDICATOR),
    ]
    return solids + pair + [g.mirrored(p) for p in pair]


def _flank(shape: CarShape, material: Material, has_strip: bool) -> list[MeshPart]:
    """Return the door gaps, handles, mirror and cladding of the left side."""
    side, axle, arch = shape.width / 2, shape.wheelbase / 2, shape.wheel_radius * 1.22
    sill, belt = shape.clearance + 0.16, shape.belt - 0.05
    solids = []
    doors = sorted({*shape.pillars, shape.side_glass[1] + 0.06, *((shape.cabin_low[0] + 0.08,) if shape.bed else ())})
    for x in doors:
        over = [
            shape.wheel_radius + math.sqrt(max(arch**2 - (x - c) ** 2, 0.0)) for c in (-axle, axle) if abs(x - c) < arch
        ]
        solids.append(
            g.box((x - 0.006, side - 0.03, max([sill, *over])), (x + 0.006, side + 0.003, belt - 0.1), materials.SHADOW)
        )
    solids.append(
        g.box((doors[0], side - 0.03, belt - 0.105), (doors[-1], side + 0.002, belt - 0.098), materials.SHADOW)
    )
    for x in doors[:-1]:
        solids.append(g.box((x + 0.10, side - 0.02, belt - 0.20), (x + 0.28, side + 0.022, belt - 0.165), material))
    x, z = shape.side_glass[1] - 0.08, shape.belt
    base = _cabin_side(shape, x, z + 0.1)
    solids.append(g.box((x - 0.06, base + 0.05, z + 0.03), (x + 0.06, base + 0.24, z + 0.18), material))
    solids.append(g.box((x - 0.075, base + 0.06, z + 0.045), (x - 0.058, base + 0.23, z + 0.165), materials.GLASS))
    solids.append(g.box((x - 0.02, base - 0.03, z + 0.03), (x + 0.02, base + 0.08, z + 0.07), materials.TRIM))
    if has_strip:
        solids.append(
            g.box((arch - axle, side - 0.03, sill + 0.18), (axle - arch, side + 0.010, sill + 0.23), materials.TRIM)
        )
    if shape.cladding:
        solids.append(
            g.box(
                (arch - axle, side - 0.03, shape.clearance),
                (axle - arch, side + 0.012, shape.clearance + 0.14),
                materials.TRIM,
            )
        )
        turn = np.linspace(0.02, np.pi - 0.02, 13)
        for c in (-axle, axle):
            arcs = [
                np.stack(
                    [c + r * np.cos(turn), np.full(13, side + 0.014), shape.wheel_radius + r * np.sin(turn)], axis=1
                )
                for r in (arch * 1.12, arch * 0.985)
            ]
            solids.append(g.grid(arcs, materials.TRIM, 0.0))
    return solids


def _bed(shape: CarShape, reach: tuple[float, float], material: Material) -> list[MeshPart]:
    """Return a pickup's load bed: a dark floor between raised sides."""
    (x0, x1), side = reach, shape.width / 2
    z = float(np.interp(x0, *np.array(shape.deck).T)) + 0.036
    wall = g.box((x0 - 0.06, side - 0.16, z - 0.15), (x1 + 0.1, side - 0.05, z + 0.09), material)
    return [
        g.box((x0, -side + 0.16, z - 0.02), (x1, side - 0.16, z), materials.TRIM),
        g.box((x0 - 0.10, -side + 0.06, z - 0.15), (x0, side - 0.06, z + 0.09), material),
        wall,
        g.mirrored(wall),
    ]


def plates(text: str, rear: tuple[float, float], front: tuple[float, float]) -> list[MeshPart]:
    """Return both number plates, given (x, height of the lower edge) of each."""
    picture = lettering.plate(text)
    sign = Material(f"plate-{text}", (1.0, 1.0, 1.0), picture, emission=0.05)
    h = DIGIT_M * picture.shape[0] / lettering.CAP_PX
    w = DIGIT_M * picture.shape[1] / lettering.CAP_PX / 2
    (x, z), (nose, low) = rear, front
    back = g.panel(x, (w, -w), (z, z + h), sign)
    return [back, g.panel(nose, (-w, w), (low, low + h), sign)]


def car(kind: str, paint: str, plate: str, trim: Trim = PLAIN) -> Mesh:
    """Return a car of SHAPES in a paint of `materials.PAINTS`; `plate` is written on its number plates.

    If `trim.shade` is not None, `paint` must be a key of SHADES. Raises UsageError for an unknown paint.
    """
    shape = SHAPES[kind]
    material = materials.paint(paint) if trim.shade is None else materials.shade(paint, trim.shade)
    nose, tail, low = shape.deck[-1][1], shape.deck[0][1], shape.clearance + 0.08
    end = float(plan_at(shape, np.array([shape.length / 2]))[0])
    flank = _flank(shape, material, trim.has_strip)
    solids = [*body(shape, material, trim.rise_m), *_cabin(shape, material, trim.roof), *_wheels(shape, trim)]
    solids += [*flank, *map(g.mirrored, flank), *_lamps(shape, trim, end, nose, tail, low)]
    half = shape.length / 2 + 0.027
    solids += plates(plate, (-half, max(tail - 0.52, low + 0.20)), (half, low - 0.01))
    if shape.bed is not None:
        solids += _bed(shape, shape.bed, material)
    return g.assemble(solids)
