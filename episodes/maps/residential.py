"""A residential street: two rows of houses with lawns, drives, trees and parked cars in neutral paints.

The street runs north; `across` is the distance east of its centre line. Levels follow the paper's residential map: the
road at +0.05 m and the drives at −0.45 m, NED (appendix "Maps and Episodes"), so plots stand half a metre above it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dronecats.border.terrain import HeightField
from episodes import geometry as g
from episodes.assets import houses, plants, street, vehicles
from episodes.assets.paint import WHITE_WOOD
from episodes.assets.textures import surface
from episodes.geometry import Array, Part
from episodes.scene import Instance, Material, Mesh, Scene, Sun

ORIGIN = (47.397742, 8.545594, 488.0)  # PX4's usual SITL home
REACH_NORTH, REACH_EAST = 70.0, 45.0  # m, half extents of the height field; beyond it the ground is level
CELL = 0.25  # m
LOTS = (-50.0, -30.0, -10.0, 10.0, 30.0, 50.0)  # m north, middle of the plots on either side
FRONT = 14.0  # m, house fronts from the centre line
DRIVE_HALF = 2.3  # m

# distance from the centre line → NED z: road, kerb, verge, pavement, bank, plot
PROFILE = ((0.0, 0.05), (4.0, 0.05), (4.25, -0.07), (5.5, -0.09), (7.0, -0.12), (9.5, -0.45), (50.0, -0.45))
PROFILE_DRIVE = ((0.0, 0.05), (4.0, 0.05), (5.5, -0.09), (7.0, -0.12), (9.5, -0.45), (50.0, -0.45))

# kind, paint, north, east, yaw: parked along the kerb as right-hand traffic leaves them, or nose-in on a drive
PARKED = (
    ("sedan", "grey", -20.0, 2.9, 0.0),
    ("hatchback", "white", 24.0, 2.9, 0.0),
    ("sedan", "black", -17.0, -2.9, np.pi),
    ("van", "white", 42.0, -2.9, np.pi),
    ("pickup", "silver", -52.0, -2.9, np.pi),
)
PARKED_ON_DRIVES = (
    (1, -1, "suv", "black"),
    (4, -1, "sedan", "silver"),
    (3, 1, "hatchback", "grey"),
    (0, 1, "suv", "white"),
)


def _plans(seed: int) -> dict[tuple[int, int], tuple[houses.HousePlan, float]]:
    """Return (lot, side) → (plan, north of the main block); the whole house is centred on its plot."""
    found = {}
    for lot, north in enumerate(LOTS):
        for side in (-1, 1):
            plan = houses.plan_of(seed * 1000 + lot * 2 + (side > 0))
            # seen from the house, left is north on the west side and south on the east side
            garage = 1 if (lot + (side > 0) + seed) % 2 else -1
            plan = replace(plan, garage=garage, garage_width=5.4)
            found[lot, side] = (plan, north + side * garage * plan.garage_width / 2)
    return found


def _drives(seed: int) -> dict[tuple[int, int], float]:
    """Return (lot, side) → north of the drive's middle."""
    return {
        key: north - key[1] * plan.garage * (plan.width + plan.garage_width) / 2
        for key, (plan, north) in _plans(seed).items()
    }


def _swell(north: Array) -> Array:
    """Return the gentle rise of the street away from its middle, NED z."""
    return 0.2 * (np.cos(np.pi * np.clip(north, -REACH_NORTH, REACH_NORTH) / REACH_NORTH) - 1.0)


def _height(north: Array, east: Array, drives: dict[tuple[int, int], float]) -> Array:
    """Return NED z of the ground at broadcast coordinates."""
    away = np.abs(east)
    plain = np.interp(away, *np.array(PROFILE).T)
    ramp = np.interp(away, *np.array(PROFILE_DRIVE).T)
    share = np.zeros(np.broadcast(north, east).shape)
    for (_, side), middle in drives.items():
        flank = np.clip((DRIVE_HALF + 0.25 - np.abs(north - middle)) / 0.25, 0.0, 1.0)
        share = np.maximum(share, flank * (np.sign(east) == side))
    return np.asarray(plain * (1.0 - share) + ramp * share + _swell(north))


def _terrain(drives: dict[tuple[int, int], float]) -> HeightField:
    north = np.arange(-REACH_NORTH, REACH_NORTH + CELL / 2, CELL)
    east = np.arange(-REACH_EAST, REACH_EAST + CELL / 2, CELL)
    return HeightField(-REACH_NORTH, -REACH_EAST, CELL, _height(north[:, None], east[None, :], drives))


def _ground(drives: dict[tuple[int, int], float]) -> list[tuple[str, Mesh]]:
    """Return the ground as one mesh per use, all cut from one lattice so that their edges meet."""
    half = np.array([0.0, 4.0, 4.25, 5.5, 7.0, 8.25, 9.5, 13.6, 20.0, 28.0, 36.0, 45.0, 70.0, 120.0, 220.0, 420.0])
    east = np.concatenate([-half[:0:-1], half])
    flanks = [m + s * (DRIVE_HALF + d) for m in drives.values() for s in (-1, 1) for d in (0.0, 0.25)]
    far = [-420.0, -220.0, -120.0, -60.0, 60.0, 120.0, 220.0, 420.0]
    north = np.unique(np.round(np.concatenate([np.arange(-70.0, 70.1, 5.0), flanks, far]), 3))
    z = _height(north[:, None], east[None, :], drives)
    n, e = np.broadcast_arrays(north[:, None], east[None, :])
    # authored in FLU: forward north, left west, up
    lattice = np.stack([n, -e, -z], axis=2)
    mid_n, mid_e = (north[:-1] + north[1:]) / 2, (east[:-1] + east[1:]) / 2
    away = np.broadcast_to(np.abs(mid_e), (len(mid_n), len(mid_e)))
    drive = np.zeros_like(away, dtype=bool)
    for (_, side), middle in drives.items():
        drive |= (np.abs(mid_n - middle) < DRIVE_HALF)[:, None] & (np.sign(mid_e) == side)[None, :]
    drive &= (away > 4.0) & (away < 13.6)
    walk = (away > 5.5) & (away < 7.0)
    kerb = (away > 4.0) & (away < 4.25) & ~drive
    road = away < 4.0
    uses: tuple[tuple[str, NDArray[np.bool_], Material, float, float], ...] = (
        ("road", road, surface("asphalt"), 4.0, 0.0),
        ("kerb", kerb, surface("concrete", (0.92, 0.92, 0.92)), 1.5, 0.0),
        ("pavement", walk, surface("concrete"), 1.5, 5.5),
        ("drive", drive & ~walk, surface("concrete", (0.82, 0.80, 0.77)), 2.3, 0.0),
        *_lawns(~(road | kerb | walk | drive), mid_n, mid_e),
    )
    return [(name, g.assemble([_cells(lattice, mask, look, tile, shift)])) for name, mask, look, tile, shift in uses]


def _lawns(
    green: NDArray[np.bool_], north: Array, east: Array
) -> list[tuple[str, NDArray[np.bool_], Material, float, float]]:
    """Return the green cells in three tints, one per plot, and the fields beyond."""
    near = (np.abs(north) < 60.0)[:, None] & (np.abs(east) < 36.0)[None, :]
    shade = (np.floor((north + 60.0) / 20.0)[:, None] * 2 + (east > 0)[None, :] * 3) % 3
    tints = ((1.0, 1.0, 1.0), (1.12, 1.06, 1.0), (0.86, 0.93, 0.9))
    found = [
        (f"lawn-{k}", green & near & (shade == k), surface("grass", tint), 4.0, 0.0) for k, tint in enumerate(tints)
    ]
    return [*found, ("field", green & ~near, surface("grass", (1.0, 0.97, 0.95)), 11.0, 0.0)]


def _cells(lattice: Array, mask: NDArray[np.bool_], look: Material, tile: float, shift: float) -> Part:
    """Return the chosen cells of a lattice, textured in plan."""
    i, j = np.nonzero(mask)
    a, b, c, d = lattice[i, j], lattice[i + 1, j], lattice[i + 1, j + 1], lattice[i, j + 1]
    # columns run east, i.e. towards -y: d, c, b, a is counter-clockwise seen from above
    tri = np.concatenate([np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)])
    part = g.soup(tri, look, 25.0, tile)
    flat = np.stack([part.corners[..., 0], np.abs(part.corners[..., 1]) - shift], axis=2) / tile
    return replace(part, uv=flat)


def _markings(terrain: HeightField) -> Mesh:
    """Return the dashed centre line and a crossing, a few millimetres above the road."""
    strips = [(n, n + 3.0, -0.06, 0.06) for n in np.arange(-66.0, 66.0, 9.0)]
    strips += [(19.0, 21.6, e, e + 0.5) for e in np.arange(-3.7, 3.6, 1.0)]
    parts = []
    for n0, n1, e0, e1 in strips:
        z0, z1 = -terrain.at(n0, 0.0) + 0.008, -terrain.at(n1, 0.0) + 0.008
        parts.append(g.quad([(n0, -e0, z0), (n0, -e1, z0), (n1, -e1, z1), (n1, -e0, z1)], WHITE_WOOD))
    return g.assemble(parts)


def _garden(
    lot: int, side: int, drive: float, plan: houses.HousePlan, house: float, seed: int
) -> Iterator[tuple[str, Mesh, float, float, float]]:
    """Yield (kind, mesh, north, east, yaw) of what grows and stands on one plot."""
    rng = np.random.default_rng((seed, lot, side + 1))
    middle = LOTS[lot]
    free = middle + 5.0 * np.sign(middle - drive)  # the half of the front lawn without the drive
    species = ("oak", "maple", "birch")[int(rng.integers(3))]
    if rng.random() < 0.62:
        height = (6.4, 7.2, 8.0)[int(rng.integers(3))]
        yield (
            "tree",
            plants.tree(species, height, 1 + int(rng.integers(2))),
            free + rng.uniform(-1, 1),
            side * rng.uniform(9.8, 10.6),
            float(rng.uniform(0, 6)),
        )
    back = float(rng.uniform(-6, 6)) + middle
    yield (
        "conifer",
        plants.conifer((7.0, 9.0, 11.0)[int(rng.integers(3))], 1 + int(rng.integers(2))),
        back,
        side * rng.uniform(27, 30),
        float(rng.uniform(0, 6)),
    )
    edge = middle + 9.7
    if lot < len(LOTS) - 1:
        yield "fence", street.board_fence(14.0), edge, side * 25.0, np.pi / 2
        if rng.random() < 0.6:
            yield "hedge", plants.hedge(3.6, 1.1, 0.7, lot + 2), edge, side * 11.6, np.pi / 2
    yield "fence", street.board_fence(19.4), middle, side * 32.0, 0.0
    if (lot + side) % 3 == 0:
        near, far = sorted(
            (middle + 9.0 * np.sign(middle - drive), drive + (DRIVE_HALF + 0.4) * np.sign(middle - drive))
        )
        yield "fence", street.picket_fence(far - near), (near + far) / 2, side * 7.35, 0.0
    door, wide = house - side * houses.door_y(plan), max(plan.porch, 1.6) / 2 + 0.8
    for k, n in enumerate(np.linspace(house - plan.width / 2 + 0.9, house + plan.width / 2 - 0.9, 6)):
        if abs(n - door) > wide:
            yield (
                "bush",
                plants.bush((0.42, 0.5, 0.58)[k % 3], k % 3 + 1),
                n,
                side * (FRONT - 0.75),
                float(rng.uniform(0, 6)),
            )
    toward = -side * np.pi / 2
    away = np.sign(middle - drive)
    yield "mailbox", street.mailbox(), drive + away * (DRIVE_HALF + 0.7), side * 4.75, toward
    if rng.random() < 0.5:
        yield "bin", street.bin(), drive - away * (DRIVE_HALF + 0.25), side * 12.9, toward


def _backdrop(seed: int) -> Iterator[tuple[str, Mesh, float, float, float]]:
    """Yield trees, houses and woods beyond the plots, so that no view ends in a bare horizon."""
    rng = np.random.default_rng((seed, 77))
    firs = [plants.conifer(h, 1) for h in (9.0, 11.0, 7.0)]
    rows = [houses.house(replace(houses.plan_of(seed * 77 + k), porch=0.0)) for k in range(3)]
    for side in (-1, 1):
        for n in np.arange(-84.0, 85.0, 28.0):
            yield (
                "conifer",
                firs[int(rng.integers(3))],
                n + rng.uniform(-4, 4),
                side * rng.uniform(38, 44),
                float(rng.uniform(0, 6)),
            )
        for k, n in enumerate((-42.0, -4.0, 36.0)):
            yield "house", rows[(k + (side > 0)) % 3], n, side * 56.0, -side * np.pi / 2
        for k, n in enumerate((-78.0, 78.0)):
            yield "house", rows[k], n, side * 17.0, -side * np.pi / 2
        for k, n in enumerate((-150.0, -90.0, -30.0, 30.0, 90.0, 150.0)):
            yield "wood", plants.wood(64.0, 10.0, 1 + k % 2), n, side * 88.0, 0.0
    for end in (-1, 1):
        for e in (-11.0, 9.5, 28.0, -30.0):
            yield (
                "conifer",
                firs[int(rng.integers(3))],
                end * rng.uniform(92, 112),
                e + rng.uniform(-1, 1),
                float(rng.uniform(0, 6)),
            )
        for k, e in enumerate((-64.0, 0.0, 64.0)):
            yield "wood", plants.wood(64.0, 10.0, 1 + k % 2), end * 176.0, e, np.pi / 2


def build(seed: int = 1) -> Scene:
    """Return the street. `seed` varies houses and planting; the plan of roads, plots and parked cars stays."""
    plans, drives = _plans(seed), _drives(seed)
    terrain = _terrain(drives)
    instances: list[Instance] = []

    def add(kind: str, mesh: Mesh, north: float, east: float, yaw: float, solid: bool = True) -> None:
        number = len(instances) + 1
        place = (float(north), float(east), terrain.at(north, east))
        instances.append(Instance(number, f"{kind}-{number}", kind, mesh, place, float(yaw), False, solid))

    for name, mesh in _ground(drives):
        number = len(instances) + 1
        instances.append(Instance(number, name, "ground", mesh, (0.0, 0.0, 0.0)))
    number = len(instances) + 1
    instances.append(Instance(number, "marking", "ground", _markings(terrain), (0.0, 0.0, 0.0), solid=False))
    for (lot, side), (plan, north) in plans.items():
        east = side * (FRONT + plan.depth / 2)
        place = (float(north), float(east), terrain.at(drives[lot, side], east))
        number = len(instances) + 1
        instances.append(Instance(number, f"house-{number}", "house", houses.house(plan), place, -side * np.pi / 2))
        for item in _garden(lot, side, drives[lot, side], plan, north, seed):
            add(*item)
    for k, n in enumerate(np.arange(-55.0, 56.0, 22.0)):
        side = -1 if k % 2 else 1
        add("lamp", street.lamp(), n, side * 4.75, -side * np.pi / 2)
    add("hydrant", street.hydrant(), 3.0, -4.9, np.pi / 2)
    for index, (kind, paint, north, east, yaw) in enumerate(PARKED):
        add(kind, vehicles.car(kind, paint, f"RS {1200 + 37 * index}"), north, east, yaw)
    for index, (lot, side, kind, paint) in enumerate(PARKED_ON_DRIVES):
        car = vehicles.car(kind, paint, f"RS {3100 + 41 * index}")
        add(kind, car, drives[lot, side] + 0.2, side * 11.1, side * np.pi / 2)
    for item in _backdrop(seed):
        add(*item)
    azimuth, elevation = np.radians(142.0), np.radians(50.0)  # late morning, northern summer
    sun = (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation))
    return Scene(
        name="residential",
        instances=tuple(instances),
        terrain=terrain,
        sun=Sun((float(sun[0]), float(sun[1]), float(sun[2]))),
        latitude_deg=ORIGIN[0],
        longitude_deg=ORIGIN[1],
        altitude_m=ORIGIN[2],
        spawn_ned=(0.0, 0.0, terrain.at(0.0, 0.0)),
        notes=("The street runs north; the plots lie east and west of it.",),
    )
