"""Builds a campus: a plaza and four courts between halls of three to five storeys, with lawns, walks and many fixtures.

All fixtures of a kind look the same, so only their places distinguish them. No two people look the same. The plan is in
`campus_plan`.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from episodes.maps import assets, campus_ground, campus_plan
from episodes.maps.assets import buildings, campus_fixtures, people, plants, service_vehicles
from episodes.maps.geometry import PlanBox, gap_m
from episodes.maps.scene import Instance, Lane, Mesh, Places, Scene, Spot, sun_at
from foundation.terrain import HeightField

ORIGIN = (52.204300, 0.119400, 21.0)  # geodetic latitude, longitude (degrees) and height (m) of the plaza's middle
MAY, HOUR = 135, 10.4  # day of the year and true solar hour
STEP_M = 1.0  # m between the waypoints of a lane: the ground bends less than a millimetre in between
SPOT_GRID_M = 4.0  # m between points checked for free space
SPOT_CLEAR_M = 1.6  # m, least distance of a free place from any object
PlacedMesh = tuple[str, Mesh, float, float, float]  # kind, mesh, north, east, yaw in rad


def _placed_meshes(seed: int) -> Iterator[PlacedMesh]:
    """Yield all objects of the campus except the halls. Their order gives the numbers in the names of instances."""
    parked = {"delivery-robot": service_vehicles.delivery_robot, "service-cart": service_vehicles.service_cart}
    people_seen = itertools.count()
    yield "fountain", campus_fixtures.fountain(3), *campus_plan.TIERED, 0.0
    for kind, north, east, facing in campus_plan.FIXTURES:
        if kind == "person":
            mesh = people.passer_by(next(people_seen))
        else:
            mesh = parked[kind]("white") if kind in parked else assets.FIXTURES[kind]()
        yield kind, mesh, north, east, math.radians(facing)
    rng = np.random.default_rng((seed, 11))
    for k, (species, north, east, height) in enumerate(campus_plan.TREES):
        mesh = plants.tree(species, height, 1 + 2 * (k % 3) + int(rng.integers(2)))
        yield "tree", mesh, north, east, float(rng.uniform(0.0, 2.0 * np.pi))
    for k, (north, east, height) in enumerate(campus_plan.CONIFERS):
        mesh = plants.conifer(height, 1 + 2 * (k % 3) + int(rng.integers(2)))
        yield "conifer", mesh, north, east, float(rng.uniform(0, 6))
    yield from _shrubs(rng)
    yield from _backdrop()


def _shrubs(rng: np.random.Generator) -> Iterator[PlacedMesh]:
    """Yield shrubs along the front of each hall, four at each corner, except near a fixture."""
    taken = np.array([(north, east) for _, north, east, _ in campus_plan.FIXTURES])
    for plan, north, east, facing in campus_plan.HALLS:
        yaw = math.radians(facing)
        for side in (-1, 1):
            for k in range(4):
                out, along = plan.depth / 2 + 1.4, side * (plan.width / 2 - 1.4 - 1.7 * k)
                n = north + math.cos(yaw) * out - math.sin(yaw) * along
                e = east + math.sin(yaw) * out + math.cos(yaw) * along
                if np.hypot(taken[:, 0] - n, taken[:, 1] - e).min() > 3.6:
                    yield "shrub", plants.bush((0.5, 0.58, 0.42)[k % 3], k % 3 + 1), n, e, float(rng.uniform(0, 6))


def _backdrop() -> Iterator[PlacedMesh]:
    """Yield the woods around the campus, so that no view ends in a bare horizon."""
    for side in (-1, 1):
        for k, along in enumerate((-90.0, -30.0, 30.0, 90.0)):
            yield "wood", plants.wood(64.0, 10.0, 1 + k), side * 104.0, along, np.pi / 2
            yield "wood", plants.wood(64.0, 10.0, 5 + k), along, side * 104.0, 0.0


def build(seed: int = 1) -> Scene:
    """Return the campus. `seed` varies the shapes of its plants; halls, walks and fixtures do not change."""
    terrain, count = campus_ground.terrain(), Counter[str]()
    ground = enumerate(campus_ground.ground(), 1)
    instances = [Instance(number, use, "ground", mesh, (0.0, 0.0, 0.0)) for number, (use, mesh) in ground]

    def add(kind: str, mesh: Mesh, north: float, east: float, down: float, yaw: float) -> None:
        count[kind] += 1
        place = (float(north), float(east), float(down))
        instances.append(Instance(len(instances) + 1, f"{kind}-{count[kind]}", kind, mesh, place, float(yaw)))

    for plan, north, east, facing in campus_plan.HALLS:
        yaw = math.radians(facing)
        out = plan.depth / 2 + 2.0  # the hall stands at the level of the ground in front of its door
        down = terrain.at(north + math.cos(yaw) * out, east + math.sin(yaw) * out)
        add("hall", buildings.hall(plan), north, east, down, yaw)
    for kind, mesh, north, east, yaw in _placed_meshes(seed):
        add(kind, mesh, north, east, terrain.at(north, east), yaw)
    return Scene(
        "campus",
        tuple(instances),
        terrain,
        sun_at(ORIGIN[0], MAY, HOUR),
        *ORIGIN,
        spawn_ned=(12.0, 0.0, terrain.at(12.0, 0.0)),
        spawn_yaw=math.pi,
        notes=("The library stands north of the plaza; walks lead from it to the halls east, south and west.",),
    )


def places(seed: int = 1) -> Places:
    """Return the free places, lanes and landmarks.

    `seed` turns the footprints of plants, so it can change a few free places beside them. Lanes and landmarks do not
    change.
    """
    terrain = campus_ground.terrain()
    lanes = tuple(
        Lane(name, tuple((n, e, round(terrain.at(n, e), 4)) for n, e in _stepped(corners)), campus_plan.LANE_WIDTH_M)
        for name, corners in campus_plan.LANES
    )
    return Places(tuple(_spots(terrain, seed)), lanes, campus_plan.LANDMARKS)


def _stepped(corners: tuple[tuple[float, float], ...]) -> list[tuple[float, float]]:
    """Return the corners and points between them, so that neighbours are at most STEP_M apart."""
    points = [corners[0]]
    for (n0, e0), (n1, e1) in itertools.pairwise(corners):
        count = math.ceil(math.hypot(n1 - n0, e1 - e0) / STEP_M)
        steps = [k / count for k in range(1, count + 1)]
        points += [(round(n0 + (n1 - n0) * u, 3), round(e0 + (e1 - e0) * u, 3)) for u in steps]
    return points


def _spots(terrain: HeightField, seed: int) -> Iterator[Spot]:
    """Yield free places on a grid over the campus. Objects there face the plaza."""
    blocks = list(_blocks(seed))
    for north in np.arange(-84.0, 46.1, SPOT_GRID_M):
        for east in np.arange(-50.0, 52.1, SPOT_GRID_M):
            n, e = float(north), float(east)
            if all(gap_m(n, e, block) >= SPOT_CLEAR_M for block in blocks):
                yield Spot((n, e, round(terrain.at(n, e), 4)), math.atan2(-e, -n), campus_ground.use_at(n, e))


def _blocks(seed: int) -> Iterator[PlanBox]:
    """Yield the footprints of all objects but far woods. A tree has a fixed square footprint."""
    for kind, mesh, north, east, yaw in _placed_meshes(seed):
        if kind in ("tree", "conifer"):
            half = np.array((0.5, 0.5)) if kind == "tree" else np.array((2.2, 2.2))
            yield north, east, yaw, -half, half
        elif kind != "wood":
            yield north, east, yaw, mesh.vertices[:, :2].min(axis=0), mesh.vertices[:, :2].max(axis=0)
    for plan, north, east, facing in campus_plan.HALLS:
        forward, back, side = buildings.reach(plan)
        yield north, east, math.radians(facing), np.array((-back, -side)), np.array((forward, side))
