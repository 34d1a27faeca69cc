"""Draws plans of suburban houses from a seed: dimensions, colours and styles."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from episodes.maps.assets.materials import Srgb

WALLS: dict[str, Srgb] = {
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
BRICKS: dict[str, Srgb] = {  # factors on a red texture; 255 is 1
    "red": (255, 255, 255),
    "brown": (206, 214, 218),
    "buff": (226, 204, 168),
    "grey": (176, 178, 180),
    "white": (240, 236, 228),
}
ROOFS: dict[str, Srgb] = {
    "charcoal": (92, 92, 98),
    "umber": (122, 98, 82),
    "stone": (140, 136, 130),
    "rust": (136, 88, 70),
    "slate": (84, 92, 104),
    "sand": (164, 144, 118),
    "moss": (96, 104, 90),
}
DOORS: dict[str, Srgb] = {
    "oak": (120, 76, 44),
    "ink": (38, 48, 66),
    "moss": (54, 82, 58),
    "wine": (96, 32, 38),
    "soot": (38, 38, 40),
    "pale": (214, 212, 204),
    "teal": (46, 92, 96),
}
SHUTTERS: dict[str, Srgb] = {
    "none": (0, 0, 0),
    "ink": (40, 50, 66),
    "moss": (52, 70, 56),
    "umber": (84, 62, 48),
    "soot": (48, 48, 50),
}
GARAGE_DOORS: dict[str, Srgb] = {
    "white": (255, 255, 255),
    "oak": (170, 128, 96),
    "grey": (178, 180, 184),
    "cream": (250, 240, 216),
}
TRIMS: dict[str, Srgb] = {
    "white": (232, 231, 226),
    "cream": (222, 212, 186),
    "soot": (54, 54, 56),
    "bronze": (92, 76, 62),
    "dove": (178, 178, 174),
}
# styles listed twice are drawn twice as often
CLADDINGS = ("lap", "lap", "battens", "shakes", "render")
ROOFINGS = ("shingles", "shingles", "tiles", "seams")
WINDOWS = ("sash", "grid", "casement", "plain")
DOOR_STYLES = ("panel", "glazed", "planks")
POSTS = ("slim", "stout", "round")
RAILINGS = ("balusters", "solid", "none")
GARAGE_STYLES = ("panels", "lights", "planks")
ON_ROOFS = ("nothing", "panels", "skylights", "nothing")


@dataclass(frozen=True, slots=True)
class HousePlan:
    """Dimensions and features of one house, m. The front faces forward (+x), y runs to the left."""

    width: float = 11.0  # of the main block, along y
    depth: float = 9.0
    storeys: int = 1
    pitch: float = 0.55  # rise over run of the roof
    gable_front: bool = False  # the ridge runs front to back
    wall: str = "cream"  # in WALLS
    brick: bool = False  # all walls are brick
    roof: str = "charcoal"  # in ROOFS
    door: str = "oak"  # in DOORS
    garage: int = 1  # +1 on the left, -1 on the right, 0 none
    garage_width: float = 5.6
    porch: float = 3.6  # width of the porch, 0 none
    chimney: bool = True
    hipped: bool = False  # the roof slopes on all four sides
    dormers: int = 0  # small windows in the front slope of the roof
    band: bool = False  # the lower of two storeys is brick
    shutters: str = "none"  # in SHUTTERS
    garage_door: str = "white"  # in GARAGE_DOORS
    cladding: str = "lap"  # in CLADDINGS, where the wall is not brick
    bricks: str = "red"  # in BRICKS
    roofing: str = "shingles"  # in ROOFINGS
    trim: str = "white"  # in TRIMS: window frames, corners, eaves
    window: str = "sash"  # in WINDOWS
    door_style: str = "panel"  # in DOOR_STYLES
    posts: str = "slim"  # in POSTS; for the porch
    railing: str = "balusters"  # in RAILINGS
    garage_style: str = "panels"  # in GARAGE_STYLES
    on_roof: str = "nothing"  # in ON_ROOFS


def plan_of(seed: int) -> HousePlan:
    """Return a plan drawn from the seed. The caller sets the side of the garage."""
    rng = np.random.default_rng(seed)

    def pick(names: Sequence[str]) -> str:
        return names[int(rng.integers(len(names)))]

    # Keep the order of these draws: it decides the dimensions, and so the places of things on the plot.
    storeys = int(rng.integers(1, 3))
    plan = HousePlan(
        width=float(rng.uniform(8.5, 10.0) if storeys == 2 else rng.uniform(10.0, 12.0)),
        depth=float(rng.uniform(8.0, 9.2)),
        storeys=storeys,
        pitch=float(rng.uniform(0.5, 0.75)),
        gable_front=bool(rng.random() < 0.35),
        wall=pick(list(WALLS)),
        brick=bool(rng.random() < 0.28),
        roof=pick(list(ROOFS)[:6]),
        door=pick(list(DOORS)[:4]),
        porch=float(rng.choice([0.0, 3.4, 4.6])),
        chimney=bool(rng.random() < 0.7),
    )
    hipped = bool(rng.random() < 0.3)
    loft = storeys == 1 and not plan.gable_front and not hipped and plan.pitch > 0.58
    plan = replace(
        plan,
        hipped=hipped,
        dormers=int(rng.integers(1, 3)) if loft else 0,
        band=storeys == 2 and not plan.brick and bool(rng.random() < 0.4),
        shutters=pick(list(SHUTTERS)),
        garage_door=pick(list(GARAGE_DOORS)),
    )
    return replace(
        plan,
        cladding=pick(CLADDINGS),
        bricks=pick(list(BRICKS)),
        roofing=pick(ROOFINGS),
        trim=pick(("white", *TRIMS)),
        window=pick(WINDOWS),
        door=pick(list(DOORS)),
        door_style=pick(DOOR_STYLES),
        posts=pick(POSTS),
        railing=pick(RAILINGS),
        garage_style=pick(GARAGE_STYLES),
        on_roof=pick(ON_ROOFS) if not plan.dormers else "nothing",
    )


def differ_from_neighbours(plan: HousePlan, neighbours: Iterable[HousePlan]) -> HousePlan:
    """Return the plan with walls, bricks, roof, door and windows that no neighbour has, as far as possible."""
    near = list(neighbours)
    return replace(
        plan,
        wall=_free(plan.wall, list(WALLS), {other.wall for other in near}),
        bricks=_free(plan.bricks, list(BRICKS), {other.bricks for other in near}),
        roof=_free(plan.roof, list(ROOFS), {other.roof for other in near}),
        door=_free(plan.door, list(DOORS), {other.door for other in near}),
        window=_free(plan.window, WINDOWS, {other.window for other in near}),
    )


def _free(wanted: str, names: Sequence[str], taken: set[str]) -> str:
    """Return the first name that is not taken, searching from `wanted` on; `wanted` if all are taken."""
    first = names.index(wanted)
    return next((name for name in (*names[first:], *names[:first]) if name not in taken), wanted)


def door_y(plan: HousePlan) -> float:
    """Return the y (m, left of the middle) of the front door, on the side away from the garage."""
    return -plan.garage * plan.width * 0.175
