"""Builds a residential neighbourhood: two streets of houses, two roads that join them, gardens, drives and parked cars.

The main street runs north through the origin. `residential_plan` has the streets and plots, `residential_places` the
free places for targets.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from episodes.maps import residential_plan as plan
from episodes.maps.assets import houses, plants, street, vehicles
from episodes.maps.assets.house_plans import door_y
from episodes.maps.residential_ground import ground, markings
from episodes.maps.residential_plan import (
    CORNER,
    DEPTH,
    DRIVE_HALF,
    FRONT,
    LOWER,
    MAIN,
    SECOND,
    STREETS,
    UPPER,
    Plot,
    Street,
)
from episodes.maps.scene import Instance, Mesh, Scene, Sun
from foundation.frames import PX4_HOME, vec3
from foundation.terrain import HeightField

KERBSIDE_OUT = 2.8  # m from the centre line to the middle of a vehicle that is parked along the kerb
DRIVE_OUT = 10.5  # m from the centre line to the middle of a vehicle that is parked on a drive
BAY = 6.2  # m, length of kerb for one vehicle


@dataclass(frozen=True, slots=True, eq=False)
class Furnishing:
    """One outdoor object that is not a house, and its place."""

    kind: str
    mesh: Mesh
    north: float  # m
    east: float  # m
    yaw: float  # rad


@dataclass(frozen=True, slots=True)
class Parked:
    """A parked car. Its paint is neutral, so that no parked car has the colour of a target."""

    kind: str
    paint: str
    street: Street
    along: float  # m along the street
    out: float  # m from the centre line: east if the street runs north, north if it runs east
    yaw: float  # rad


def heading(way: Street, side: int) -> float:
    """Return the yaw (rad) of traffic on one side of a street. Vehicles drive on the right.

    `side` is +1 east or north of the centre line, and -1 on the other side.
    """
    if way.north:
        return 0.0 if side > 0 else math.pi
    return -math.pi / 2 if side > 0 else math.pi / 2


def bays(homes: tuple[Plot, ...]) -> list[tuple[Street, float, int]]:
    """Return (street, along, side) of every stretch of kerb where a vehicle can stop without blocking a drive."""
    free: list[tuple[Street, int, float, float]] = []
    for plot in homes:
        low, high = plot.along - 9.8, plot.along + 9.8
        free.append((plot.street, plot.side, low, plot.drive - DRIVE_HALF - 0.5))
        free.append((plot.street, plot.side, plot.drive + DRIVE_HALF + 0.5, high))
    free += [(UPPER, -1, CORNER + 3.0, SECOND.middle - CORNER - 3.0), (LOWER, 1, CORNER + 3.0, SECOND.middle - 12.5)]
    places = []
    for way, side, low, high in free:
        count = int((high - low) / BAY)
        places += [(way, (low + high) / 2 + (k - (count - 1) / 2) * BAY, side) for k in range(count)]
    return places


def parked(homes: tuple[Plot, ...], seed: int) -> list[Parked]:
    """Return the parked cars. The seed does not change kinds and paints on the main street."""
    cars = [
        Parked("sedan", "grey", MAIN, -20.0, 2.9, 0.0),
        Parked("hatchback", "white", MAIN, 24.0, 2.9, 0.0),
        Parked("sedan", "black", MAIN, -17.0, -2.9, math.pi),
        Parked("van", "white", MAIN, 42.0, -2.9, math.pi),
        Parked("pickup", "silver", MAIN, -52.0, -2.9, math.pi),
    ]
    drives = {(-30.0, -1): ("suv", "black"), (30.0, -1): ("sedan", "silver"), (10.0, 1): ("hatchback", "grey")}
    drives[-50.0, 1] = ("suv", "white")
    rng = np.random.default_rng((seed, 5))
    kinds, paints = ("sedan", "suv", "hatchback", "pickup", "van"), ("white", "silver", "grey", "black")
    for plot in homes:
        if plot.street is MAIN:
            if (plot.along, plot.side) not in drives:
                continue
            kind, paint = drives[plot.along, plot.side]
        elif rng.random() < 0.17:
            kind, paint = kinds[int(rng.integers(4))], paints[int(rng.integers(4))]
        else:
            continue
        out = plot.side * (11.1 if plot.street is MAIN else DRIVE_OUT)
        aside = 0.2 if plot.street is MAIN else 0.0
        cars.append(Parked(kind, paint, plot.street, plot.drive + aside, out, plot.yaw + math.pi))
    for way, side, count in ((SECOND, -1, 2), (UPPER, 1, 2), (LOWER, -1, 1)):
        free = [along for s, along, k in bays(homes) if s is way and k == side]
        for along in rng.choice(free, count, replace=False):
            kind, paint = kinds[int(rng.integers(5))], paints[int(rng.integers(4))]
            cars.append(Parked(kind, paint, way, float(along), side * (KERBSIDE_OUT + 0.1), heading(way, side)))
    sedans = [k for k, car in enumerate(cars) if car.kind == "sedan"]
    for k in sedans[1::2]:
        cars[k] = replace(cars[k], kind="estate")  # as long and as wide as a sedan
    return cars


def _cars(homes: tuple[Plot, ...], seed: int) -> Iterator[Furnishing]:
    for index, car in enumerate(parked(homes, seed)):
        mesh = vehicles.car(car.kind, car.paint, plate(index), vehicles.trim_of(index))
        yield Furnishing(car.kind, mesh, *car.street.at(car.along, car.out), car.yaw)


def plate(index: int) -> str:
    """Return the text of the number plate of a parked car. No two plates are equal."""
    letters = "ABCDEFGHJKLMNPRSTUVWXYZ"
    first, second = letters[(7 * index + 3) % len(letters)], letters[(11 * index + 17) % len(letters)]
    return f"{first}{second} {1000 + (2963 * index + 1741) % 9000}"


def _fence(
    plot: Plot, low: tuple[float, float], high: tuple[float, float], terrain: HeightField
) -> Iterator[Furnishing]:
    """Yield a board fence between two points (along, out) of a plot, stepped where the ground rises along it."""
    (n0, e0), (n1, e1) = plot.at(*low), plot.at(*high)
    length = math.hypot(n1 - n0, e1 - e0)
    rise = max(terrain.at(n0, e0), terrain.at(n1, e1)) - min(terrain.at(n0, e0), terrain.at(n1, e1))
    count = max(1, math.ceil(rise / 0.12))
    for k in range(count):
        share = (k + 0.5) / count
        north, east = n0 + share * (n1 - n0), e0 + share * (e1 - e0)
        fence = street.board_fence(round(length / count, 3), tone=plot.number // 2)
        yield Furnishing("fence", fence, north, east, math.atan2(e1 - e0, n1 - n0))


def _fences(plot: Plot, homes: tuple[Plot, ...], terrain: HeightField) -> Iterator[Furnishing]:
    """Yield the fences at the back and sides of a garden. Adjacent gardens share a fence, which one of them yields."""
    neighbours = {round(o.along - plot.along) for o in homes if o.street is plot.street and o.side == plot.side}
    # whether the plot is between the two streets that run east: one side then meets gardens of a street that runs north
    is_inner = plot.street.dead and plot.along < 107.0 and abs(plot.at(0.0, DEPTH)[0]) < 60.0
    for direction in (1, -1):
        if direction == -1 and -20 in neighbours:
            continue  # the neighbouring plot yields this fence
        if is_inner and (direction > 0) == (plot.along < 0.0):
            continue  # the gardens of that street have their back fence here
        edge = plot.along + direction * 9.7
        yield from _fence(plot, (edge, 18.0), (edge, DEPTH), terrain)
    if plot.street is not SECOND or plot.side > 0:
        yield from _fence(plot, (plot.along - 9.7, DEPTH), (plot.along + 9.7, DEPTH), terrain)


def _garden(plot: Plot, homes: tuple[Plot, ...], seed: int, terrain: HeightField) -> Iterator[Furnishing]:
    """Yield the plants and objects of one plot."""
    rng = np.random.default_rng((seed, plot.number // 2, plot.side + 1) if plot.street is MAIN else (seed, plot.number))
    middle, drive, house_plan = plot.along, plot.drive, plot.plan
    off = float(np.sign(middle - drive))  # direction along the street from the drive to the front lawn
    along_street = plot.yaw + math.pi / 2

    def put(kind: str, mesh: Mesh, along: float, out: float, yaw: float) -> Furnishing:
        return Furnishing(kind, mesh, *plot.at(float(along), float(out)), float(yaw))

    species = plants.BROADLEAVES[(int(rng.integers(3)) + 2 * plot.number) % len(plants.BROADLEAVES)]
    shape = 2 * (plot.number % 3)
    if rng.random() < (0.62 if plot.street is MAIN else 0.3):
        height = (6.4, 7.2, 8.0)[int(rng.integers(3))]
        tree = plants.tree(species, height, 1 + shape + int(rng.integers(2)))
        yield put("tree", tree, middle + 5.0 * off + rng.uniform(-1, 1), rng.uniform(9.8, 10.6), rng.uniform(0, 6))
    back = float(rng.uniform(-6, 6)) + middle
    fir = plants.conifer((7.0, 9.0, 11.0)[int(rng.integers(3))], 1 + shape + int(rng.integers(2)))
    deep, turn = rng.uniform(27, 30), rng.uniform(0, 6)
    if plot.street is MAIN or plot.number // 2 % 2:
        yield put("conifer", fir, back, deep, turn)
    has_neighbour = any(o.along == middle + 20.0 for o in homes if o.street is plot.street)
    if rng.random() < (0.6 if plot.street is MAIN else 0.4) and has_neighbour:
        yield put("hedge", plants.hedge(3.6, 1.1, 0.7, 2 + plot.number // 2 % 6), middle + 9.7, 11.6, plot.yaw)
    yield from _fences(plot, homes, terrain)
    near, far = sorted((middle + 9.0 * off, drive + (DRIVE_HALF + 0.4) * off))
    kind = (plot.number // 2 + plot.side) % 3 if plot.street is MAIN else int(rng.integers(6))
    if kind == 0:
        yield put("fence", street.picket_fence(far - near, tone=plot.number // 2), (near + far) / 2, 7.35, along_street)
    elif kind == 4:
        hedge = plants.hedge(round(far - near, 1), 0.8, 0.6, 1 + plot.number % 3)
        yield put("hedge", hedge, (near + far) / 2, 7.6, along_street)
    door, wide = plot.house + plot.left * door_y(house_plan), max(house_plan.porch, 1.6) / 2 + 0.8
    wall = house_plan.width / 2 - 0.9
    for k, a in enumerate(np.linspace(plot.house - wall, plot.house + wall, 6 if plot.street is MAIN else 4)):
        if abs(a - door) > wide:
            bush = plants.bush((0.42, 0.5, 0.58)[k % 3], k % 3 + 1)
            yield put("bush", bush, a, FRONT - 0.75, rng.uniform(0, 6))
    yield put("mailbox", street.mailbox(plot.number * 3 // 2), drive + off * (DRIVE_HALF + 0.7), 4.75, plot.yaw)
    if rng.random() < 0.5:
        yield put("bin", street.bin(plot.number // 2), drive - off * (DRIVE_HALF + 0.25), 12.9, plot.yaw)


def _lamps(homes: tuple[Plot, ...]) -> Iterator[Furnishing]:
    """Yield the lamps of each street. Except on the main street, no lamp is in front of a drive."""
    lamp = street.lamp()
    for k, n in enumerate(np.arange(-55.0, 56.0, 22.0)):
        side = -1 if k % 2 else 1
        yield Furnishing("lamp", lamp, float(n), side * 4.75, -side * math.pi / 2)
    for way, runs in ((SECOND, np.arange(-53.0, 56.0, 26.5)), (UPPER, np.arange(-45.0, 112.0, 26.0)),
                      (LOWER, np.arange(-37.0, 112.0, 26.0))):  # fmt: skip
        for k, along in enumerate(runs.tolist()):
            side = -1 if k % 2 else 1
            if not way.north:
                side = 1 if way is UPPER else -1  # junctions interrupt the other side
            drives = [o.drive for o in homes if o.street is way and o.side == side]
            while any(abs(along - d) < DRIVE_HALF + 1.2 for d in drives):
                along += 0.5
            north, east = way.at(along, side * 4.75)
            yield Furnishing("lamp", lamp, north, east, heading(way, side) - math.pi / 2)


def _signs() -> Iterator[Furnishing]:
    """Yield street-name posts at the junctions, two hydrants, and barriers at the ends of Hill Road and Mill Road."""
    yield Furnishing("hydrant", street.hydrant(), 3.0, -4.9, math.pi / 2)
    yield Furnishing("hydrant", street.hydrant(), -30.5, 68.9, -math.pi / 2)
    for way in (MAIN, SECOND):
        for cross in (UPPER, LOWER):
            inward = -math.copysign(1.0, cross.middle)
            post = street.name_post(way.name, cross.name)
            yield Furnishing("street-sign", post, cross.middle + inward * 6.2, way.middle - 6.2, 0.0)
    for way in STREETS:
        if way.dead:
            for end, outward in zip(way.ends, (-1, 1), strict=True):
                north, east = way.at(end + 1.0 * outward, 0.0)
                yield Furnishing("barrier", street.barrier(7.4), north, east, 0.0)


def _backdrop(seed: int) -> Iterator[Furnishing]:
    """Yield trees and woods beyond the gardens, so that no view ends in a bare horizon."""
    rng = np.random.default_rng((seed, 77))
    shapes = itertools.cycle(range(1, 7))

    def fir() -> Mesh:
        return plants.conifer((9.0, 11.0, 7.0)[int(rng.integers(3))], next(shapes))

    for east, side in ((-32.0, -1), (96.0, 1)):
        for n in np.arange(-84.0, 85.0, 28.0).tolist():
            place = (n + rng.uniform(-4, 4), east + side * rng.uniform(4, 9) + (16.0 * side if abs(n) > 35.0 else 0.0))
            yield Furnishing("conifer", fir(), float(place[0]), float(place[1]), float(rng.uniform(0, 6)))
    for n in (-24.0, 20.0):
        maple = plants.tree("maple", 8.0, 1)
        yield Furnishing("tree", maple, n, -40.0 - float(rng.uniform(0, 6)), float(rng.uniform(0, 6)))
    for k, n in enumerate((-96.0, -32.0, 32.0, 96.0)):
        yield Furnishing("wood", plants.wood(66.0, 10.0, 1 + k), n, -84.0, 0.0)
        yield Furnishing("wood", plants.wood(66.0, 10.0, 5 + k), n, 148.0, 0.0)
    for end in (-1, 1):
        for k, e in enumerate((-56.0, 8.0, 72.0, 136.0)):
            yield Furnishing("wood", plants.wood(66.0, 10.0, 1 + k), end * 130.0, e, math.pi / 2)
        for e in np.arange(-36.0, 110.0, 36.0).tolist():
            mesh = fir()
            north, east = end * rng.uniform(108, 118), e + rng.uniform(-8, 8)
            yield Furnishing("conifer", mesh, float(north), float(east), float(rng.uniform(0, 6)))


def furnishings(homes: tuple[Plot, ...], seed: int, terrain: HeightField) -> tuple[Furnishing, ...]:
    """Return all outdoor objects except the houses, in a fixed order."""
    gardens: list[Furnishing] = []
    for plot in homes:
        gardens += _garden(plot, homes, seed, terrain)
    return (*gardens, *_lamps(homes), *_signs(), *_cars(homes, seed), *_backdrop(seed))


def build(seed: int = 1) -> Scene:
    """Return the neighbourhood. `seed` varies houses, plants and most parked cars; roads and plots do not change."""
    homes = plan.plots(seed)
    terrain = plan.terrain(homes)
    instances = [Instance(k, name, "ground", mesh, (0.0, 0.0, 0.0)) for k, (name, mesh) in enumerate(ground(homes), 1)]

    def add(kind: str, mesh: Mesh, north: float, east: float, yaw: float, level: float | None = None) -> None:
        number = len(instances) + 1
        place = (float(north), float(east), terrain.at(north, east) if level is None else level)
        instances.append(Instance(number, f"{kind}-{number}", kind, mesh, place, float(yaw)))

    marking = Instance(len(instances) + 1, "marking", "ground", markings(terrain), (0.0, 0.0, 0.0), solid=False)
    instances.append(marking)
    for plot in homes:
        out = plan.FRONT + plot.plan.depth / 2
        # the garage door opens at the level of the drive
        level = terrain.at(*plot.at(plot.drive, out))
        add("house", houses.house(plot.plan), *plot.at(plot.house, out), plot.yaw, level)
    for thing in furnishings(homes, seed, terrain):
        add(thing.kind, thing.mesh, thing.north, thing.east, thing.yaw)
    azimuth, elevation = np.radians(142.0), np.radians(50.0)  # late morning, northern summer
    sun = vec3((np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)))
    return Scene(
        "residential",
        tuple(instances),
        terrain,
        Sun(sun),
        *PX4_HOME,
        spawn_ned=(0.0, 0.0, terrain.at(0.0, 0.0)),
        notes=("Main Street and Orchard Street run north, Hill Road and Mill Road east.",),
    )
