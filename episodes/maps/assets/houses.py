"""Suburban houses: lapped walls or brick, gabled shingle roofs, framed windows, a porch, a garage and a chimney."""

from dataclasses import dataclass, replace

import numpy as np

from episodes.maps import geometry as g
from episodes.maps.assets import materials
from episodes.maps.assets.materials import surface
from episodes.maps.geometry import Array, MeshPart
from episodes.maps.scene import Material, Mesh

WALLS = {
    "cream": (236, 226, 200),
    "sage": (164, 178, 150),
    "sand": (214, 194, 162),
    "pale": (226, 228, 226),
    "slate": (142, 152, 162),
    "clay": (196, 158, 132),
    "straw": (222, 206, 152),
    "linen": (240, 238, 230),
    "mist": (174, 188, 200),
    "fern": (126, 142, 118),
    "adobe": (204, 160, 120),
    "dove": (186, 182, 176),
    "storm": (104, 116, 128),
}
ROOFS = {
    "charcoal": (92, 92, 98),
    "umber": (122, 98, 82),
    "stone": (140, 136, 130),
    "rust": (136, 88, 70),
    "slate": (84, 92, 104),
    "sand": (164, 144, 118),
}
DOORS = {"oak": (120, 76, 44), "ink": (38, 48, 66), "moss": (54, 82, 58), "wine": (96, 32, 38)}
SHUTTERS = {"none": (0, 0, 0), "ink": (40, 50, 66), "moss": (52, 70, 56), "umber": (84, 62, 48), "soot": (48, 48, 50)}
GARAGE_DOORS = {"white": (255, 255, 255), "oak": (170, 128, 96), "grey": (178, 180, 184), "cream": (250, 240, 216)}

FOUNDATION_M = 0.35  # floor above the ground
FOOTING_M = -0.9  # walls reach below the ground, which may fall away from where the house stands
STOREY_M = 2.7


@dataclass(frozen=True, slots=True)
class HousePlan:
    """What distinguishes one house; metres. The front faces forward (+x), y runs to the left."""

    width: float = 11.0  # of the main block, along y
    depth: float = 9.0
    storeys: int = 1
    pitch: float = 0.55  # rise over run of the roof
    gable_front: bool = False  # ridge runs front to back instead of along the street
    wall: str = "cream"
    brick: bool = False
    roof: str = "charcoal"
    door: str = "oak"
    garage: int = 1  # +1 on the left, -1 on the right, 0 none
    garage_width: float = 5.6
    porch: float = 3.6  # width of the porch, 0 none
    chimney: bool = True
    hipped: bool = False  # the roof slopes on all four sides
    dormers: int = 0  # small windows in the front slope of the roof
    band: bool = False  # the lower of two storeys is brick
    shutters: str = "none"
    garage_door: str = "white"


def _wall(plan: HousePlan) -> Material:
    if plan.brick:
        return surface("brick")
    return surface("siding", materials.linear(WALLS[plan.wall]))


def gable(low: tuple[float, float], high: tuple[float, float], eave: float, pitch: float, along_y: bool,
          wall: Material, tile: float, roof: Material, overhang: float = 0.45) -> list[MeshPart]:  # fmt: skip
    """Return the walls' triangles and two roof slabs over the rectangle low … high, ridge along y or x."""
    thick = 0.16
    (x0, y0), (x1, y1) = low, high
    if not along_y:
        turned = gable((y0, -x1), (y1, -x0), eave, pitch, True, wall, tile, roof, overhang)
        return [g.placed(p, yaw=np.pi / 2) for p in turned]
    middle, half = (x0 + x1) / 2, (x1 - x0) / 2
    ridge = eave + pitch * half
    solids = [g.profile([(x0, eave), (x1, eave), (middle, ridge)], y0, y1, wall, tile)]
    drop = pitch * overhang
    for end in (x0 - overhang, x1 + overhang):
        ring = [(middle, ridge), (middle, ridge + thick), (end, eave - drop + thick), (end, eave - drop)]
        solids.append(g.profile(ring, y0 - overhang, y1 + overhang, roof, 1.6))
        # fascia board under the eave
        near, far = sorted((end + np.sign(end - middle) * 0.03, end - np.sign(end - middle) * 0.05))
        solids.append(
            g.box(
                (near, y0 - overhang + 0.02, eave - drop - 0.10),
                (far, y1 + overhang - 0.02, eave - drop + 0.12),
                materials.WHITE_WOOD,
            )
        )
    return solids


def hip(
    low: tuple[float, float], high: tuple[float, float], eave: float, pitch: float, roof: Material
) -> list[MeshPart]:
    """Return a roof that slopes on all four sides of the rectangle low … high, its ridge along the longer one."""
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
        g.box((x0, y0, z - thick - 0.06), (x1, y1, z), materials.WHITE_WOOD),
        g.hull([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], ridge, roof, 1.6),
    ]


def _dormers(plan: HousePlan, eave: float, wall: Material, tile: float, roof: Material) -> list[MeshPart]:
    """Return gabled dormers on the front slope, each with its window."""
    solids: list[MeshPart] = []
    front, run = plan.depth / 2 - 1.1, 1.5 / plan.pitch
    base = eave + plan.pitch * 1.1 + 0.1
    for y in np.linspace(-0.25, 0.25, plan.dormers) * plan.width if plan.dormers > 1 else (0.0,):
        low, high = (front - run, float(y) - 0.7), (front, float(y) + 0.7)
        solids.append(g.box((*low, base - 0.3), (*high, base + 1.15), wall, tile))
        solids += gable(low, high, base + 1.15, 0.6, False, wall, tile, roof, 0.2)
        solids += window((front, float(y)), base + 0.2, 0.8, 0.85, "+x")
    return solids


def window(
    centre: tuple[float, float], sill: float, width: float, height: float, face: str, shutter: Material | None = None
) -> list[MeshPart]:
    """Return a framed sash window on the plane `face` ('+x', '-x', '+y', '-y') through `centre` (x, y)."""
    frame, glass = materials.WHITE_WOOD, materials.WINDOW
    half, top, bar = width / 2, sill + height, 0.075
    solids = [
        g.box((-0.02, -half - bar, sill - bar), (0.06, -half, top + bar), frame),
        g.box((-0.02, half, sill - bar), (0.06, half + bar, top + bar), frame),
        g.box((-0.02, -half, top), (0.06, half, top + bar), frame),
        g.box((-0.02, -half - 0.14, sill - bar), (0.11, half + 0.14, sill), frame),
        g.box((-0.02, -half, sill + height / 2 - 0.025), (0.035, half, sill + height / 2 + 0.025), frame),
        g.quad([(0.02, -half, sill), (0.02, half, sill), (0.02, half, top), (0.02, -half, top)], glass),
    ]
    if width > 1.3:
        solids.append(g.box((-0.02, -0.03, sill), (0.035, 0.03, top), frame))
    if shutter is not None:
        for y in (-half - bar - 0.34, half + bar):
            solids.append(g.box((-0.01, y, sill - bar), (0.045, y + 0.34, top + bar), shutter))
    # what lies against the wall is never seen
    solids = [g.without(p, (-1.0, 0.0, 0.0)) for p in solids]
    turn = {"+x": 0.0, "+y": np.pi / 2, "-x": np.pi, "-y": -np.pi / 2}[face]
    return [g.placed(p, (*centre, 0.0), turn) for p in solids]


def _door(x: float, y: float, floor: float, material: Material) -> list[MeshPart]:
    """Return a front door with its frame, knob and step."""
    return [
        g.box((x - 0.05, y - 0.58, floor), (x + 0.05, y + 0.58, floor + 2.22), materials.WHITE_WOOD),
        g.box((x, y - 0.47, floor), (x + 0.07, y + 0.47, floor + 2.10), material),
        g.box((x + 0.05, y - 0.30, floor + 1.15), (x + 0.085, y + 0.30, floor + 1.90), materials.WINDOW),
        g.ball((x + 0.11, y - 0.38, floor + 1.0), (0.04, 0.04, 0.04), materials.CHROME, 1),
    ]


def _porch(plan: HousePlan, front: float, y: float, roof: Material) -> list[MeshPart]:
    """Return a deck, steps, posts, railings and a lean-to roof before the door."""
    reach, half, high = 1.9, plan.porch / 2, FOUNDATION_M + 2.45
    stone = surface("concrete")
    solids = [
        g.box((front, y - half, FOOTING_M), (front + reach, y + half, FOUNDATION_M), stone, 1.5),
        g.box((front + reach, y - 0.8, FOOTING_M), (front + reach + 0.32, y + 0.8, FOUNDATION_M / 2), stone, 1.5),
        g.box((front, y - half - 0.1, high), (front + reach + 0.1, y + half + 0.1, high + 0.16), materials.WHITE_WOOD),
    ]
    ring = [
        (front, high + 0.16),
        (front + reach + 0.35, high + 0.16),
        (front + reach + 0.35, high + 0.26),
        (front, high + 0.85),
    ]
    solids.append(g.profile(ring, y - half - 0.3, y + half + 0.3, roof, 1.6))
    for side in (-1.0, 1.0):
        py = y + side * (half - 0.12)
        solids.append(
            g.box(
                (front + reach - 0.2, py - 0.08, FOUNDATION_M),
                (front + reach - 0.04, py + 0.08, high),
                materials.WHITE_WOOD,
            )
        )
        a, b = sorted((y + side * 0.85, py))
        if b - a > 0.3:
            solids.append(
                g.box(
                    (front + reach - 0.15, a, FOUNDATION_M + 0.85),
                    (front + reach - 0.09, b, FOUNDATION_M + 0.93),
                    materials.WHITE_WOOD,
                )
            )
            baluster = g.box(
                (front + reach - 0.135, -0.02, FOUNDATION_M),
                (front + reach - 0.105, 0.02, FOUNDATION_M + 0.85),
                materials.WHITE_WOOD,
            )
            for end in (-1.0, 1.0):
                baluster = g.without(baluster, (0.0, 0.0, end))
            solids += [g.placed(baluster, (0.0, float(k), 0.0)) for k in np.arange(a + 0.1, b, 0.22)]
    return solids


def _garage(plan: HousePlan, wall: Material, tile: float, roof: Material) -> list[MeshPart]:
    """Return the garage wing: a lower block whose door stands at ground level."""
    side = float(plan.garage)
    y0, y1 = sorted((side * plan.width / 2, side * (plan.width / 2 + plan.garage_width)))
    x0, x1, eave = plan.depth / 2 - 6.3, plan.depth / 2 + 0.5, 2.55
    solids = [g.box((x0, y0, FOOTING_M), (x1, y1, eave), wall, tile)]
    if plan.hipped:
        solids += hip((x0, y0), (x1, y1), eave, 0.5, roof)
    else:
        solids += gable((x0, y0), (x1, y1), eave, 0.5, False, wall, tile, roof)
    half, middle = plan.garage_width / 2 - 0.6, (y0 + y1) / 2
    door = surface("garage_door", materials.linear(GARAGE_DOORS[plan.garage_door]), 0.05)
    x = x1 + 0.03
    solids.append(
        g.box((x1 - 0.02, middle - half - 0.12, 0.0), (x1 + 0.02, middle + half + 0.12, 2.32), materials.WHITE_WOOD)
    )
    solids.append(
        g.quad(
            [(x, middle - half, 0.02), (x, middle + half, 0.02), (x, middle + half, 2.2), (x, middle - half, 2.2)], door
        )
    )
    solids.append(g.box((x1, middle - 0.09, 2.36), (x1 + 0.14, middle + 0.09, 2.52), materials.STEEL))
    return solids


def _windows(plan: HousePlan, door: float) -> list[MeshPart]:
    """Return the windows of every free wall."""
    front, half, solids = plan.depth / 2, plan.width / 2, []
    shutter = None if plan.shutters == "none" else materials.plain(f"shutter-{plan.shutters}", SHUTTERS[plan.shutters])
    for storey in range(plan.storeys):
        sill = FOUNDATION_M + storey * STOREY_M + 0.85
        for y in np.linspace(-half + 1.6, half - 1.6, 3 if plan.width < 11.5 else 4):
            if storey > 0 or abs(y - door) > 1.75:
                solids += window((front, y), sill, 1.5 if storey == 0 else 1.15, 1.35, "+x", shutter)
            solids += window((-front, y), sill, 1.2, 1.3, "-x")
        for side, face in ((1, "+y"), (-1, "-y")):
            if storey == 0 and plan.garage == side:
                continue
            for x in (-front + 2.0, front - 2.2):
                solids += window((x, side * half), sill, 1.1, 1.3, face)
    return solids


def house(plan: HousePlan) -> Mesh:
    """Return the house of a plan; its origin is the middle of the main block."""
    wall, tile = _wall(plan), 0.6 if plan.brick else 1.6
    roof = surface("shingles", materials.linear(ROOFS[plan.roof]))
    front, half = plan.depth / 2, plan.width / 2
    eave = FOUNDATION_M + plan.storeys * STOREY_M
    door = door_y(plan)
    stone = surface("concrete")
    middle = FOUNDATION_M + STOREY_M if plan.band and plan.storeys == 2 else FOUNDATION_M
    solids: list[MeshPart] = [
        g.box((-front - 0.03, -half - 0.03, FOOTING_M), (front + 0.03, half + 0.03, FOUNDATION_M), stone, 1.5),
        g.box((-front, -half, middle), (front, half, eave), wall, tile),
        *_door(front, door, FOUNDATION_M, materials.plain(f"door-{plan.door}", DOORS[plan.door], 0.2)),
        *_windows(plan, door),
    ]
    if plan.hipped:
        solids += hip((-front, -half), (front, half), eave, plan.pitch, roof)
    else:
        solids += gable((-front, -half), (front, half), eave, plan.pitch, not plan.gable_front, wall, tile, roof)
    if plan.dormers:
        solids += _dormers(plan, eave, wall, tile, roof)
    if middle > FOUNDATION_M:
        solids.append(g.box((-front, -half, FOUNDATION_M), (front, half, middle), surface("brick"), 0.6))
    if not plan.brick:
        for x in (-front, front):
            for y in (-half, half):
                solids.append(
                    g.box((x - 0.08, y - 0.08, FOUNDATION_M), (x + 0.08, y + 0.08, eave), materials.WHITE_WOOD)
                )
    if plan.gable_front and not plan.hipped:
        solids += window((front, 0.0), eave + 0.5, 0.9, 0.9, "+x")
    if plan.garage:
        solids += _garage(plan, wall, tile, roof)
    if plan.porch > 0.0:
        solids += _porch(plan, front, door, roof)
    else:
        solids.append(g.box((front, door - 0.8, FOOTING_M), (front + 1.0, door + 0.8, FOUNDATION_M), stone, 1.5))
    if plan.chimney:
        ridge = eave + plan.pitch * (min(front, half) if plan.hipped else half if plan.gable_front else front)
        x, y = (-0.9, -plan.garage * half * 0.6) if not plan.gable_front else (-front * 0.4, 0.9)
        solids.append(g.box((x - 0.4, y - 0.5, eave - 0.5), (x + 0.4, y + 0.5, ridge + 0.75), surface("brick"), 0.6))
        solids.append(g.box((x - 0.48, y - 0.58, ridge + 0.70), (x + 0.48, y + 0.58, ridge + 0.82), stone))
        solids.append(g.rod((x, y, ridge + 0.8), (x, y, ridge + 1.15), (0.15, 0.13), materials.STEEL))
    return g.assemble(solids)


def plan_of(seed: int) -> HousePlan:
    """Return a plan drawn from the seed; the garage side is left to the caller."""
    rng = np.random.default_rng(seed)

    def pick(names: dict[str, tuple[int, int, int]]) -> str:
        return list(names)[int(rng.integers(len(names)))]

    storeys = int(rng.integers(1, 3))
    plan = HousePlan(
        width=float(rng.uniform(8.5, 10.0) if storeys == 2 else rng.uniform(10.0, 12.0)),
        depth=float(rng.uniform(8.0, 9.2)),
        storeys=storeys,
        pitch=float(rng.uniform(0.5, 0.75)),
        gable_front=bool(rng.random() < 0.35),
        wall=pick(WALLS),
        brick=bool(rng.random() < 0.28),
        roof=pick(ROOFS),
        door=pick(DOORS),
        porch=float(rng.choice([0.0, 3.4, 4.6])),
        chimney=bool(rng.random() < 0.7),
    )
    hipped = bool(rng.random() < 0.3)
    loft = storeys == 1 and not plan.gable_front and not hipped and plan.pitch > 0.58
    return replace(
        plan,
        hipped=hipped,
        dormers=int(rng.integers(1, 3)) if loft else 0,
        band=storeys == 2 and not plan.brick and bool(rng.random() < 0.4),
        shutters=pick(SHUTTERS),
        garage_door=pick(GARAGE_DOORS),
    )


def door_y(plan: HousePlan) -> float:
    """Return how far left of the middle (m) the front door stands: away from the garage."""
    return -plan.garage * plan.width * 0.175


def footprint(plan: HousePlan) -> Array:
    """Return (low, high) corners (2, 2) of walls and garage, x forward and y left."""
    left = plan.width / 2 + (plan.garage_width if plan.garage > 0 else 0.0)
    right = plan.width / 2 + (plan.garage_width if plan.garage < 0 else 0.0)
    return np.array([(-plan.depth / 2, -right), (plan.depth / 2 + 0.5, left)])
