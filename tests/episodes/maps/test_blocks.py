"""The map `blocks`: closed solids apart from each other on a level floor, and room for four signs and four drones."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from episodes import maps
from episodes.maps import blocks
from episodes.maps.scene import Instance, Scene
from episodes.world.visibility import Solids
from foundation.errors import UsageError
from foundation.frames import Vec3
from tests.episodes.maps.map_plan import apart, foot

EYE_M = 1.7  # height of a drone
NEAREST, WIDEST = (5.5, 11.2), (18.0, 32.0)  # m, range of the smallest and of the largest distance between two signs
TO_NAMED, TO_EACH = (12.0, 32.0), (7.0, 37.0)  # m, range of the distance from the start grid's middle to a sign


@pytest.fixture(scope="module")
def scene() -> Scene:
    return maps.build("blocks", 1)


def standing(scene: Scene) -> list[Instance]:
    return [i for i in scene.instances if i.kind != "ground"]


def test_kinds_triangle_budget_and_unique_names(scene: Scene) -> None:
    assert {i.kind for i in scene.instances} == {"ground", "box", "cylinder", "cone", "pyramid", "ramp", "arch"}
    assert sum(len(i.mesh.triangles) for i in scene.instances) <= 20_000
    assert len({i.name for i in scene.instances}) == len(scene.instances) == len({i.id for i in scene.instances})


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 9, 77])
def test_solids_are_closed_on_the_floor_and_apart(seed: int) -> None:
    solids = standing(maps.build("blocks", seed))
    for one in solids:
        assert one.position_ned[2] == 0.0
        assert one.mesh.vertices[:, 2].max() == pytest.approx(0.0, abs=1e-6)
        t = one.mesh.vertices[one.mesh.triangles].astype(np.float64)
        assert np.einsum("ij,ij->i", t[:, 0], np.cross(t[:, 1], t[:, 2])).sum() / 6 > 5.0  # closed, faces outwards
        assert np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).min() > 1e-9
    boxes = [(i.name, foot(i)) for i in solids]
    for (a, first), (b, second) in itertools.combinations(boxes, 2):
        assert apart(first, second), f"{a} stands in {b}"


def test_no_material_has_a_saturated_colour(scene: Scene) -> None:
    for one in scene.instances:
        for material in one.mesh.materials:
            r, g, b = material.color
            assert max(r, g, b) - min(r, g, b) < 0.13


def test_the_floor_is_level(scene: Scene) -> None:
    assert not scene.terrain.down.any()
    floor = Solids(i for i in scene.instances if i.kind == "ground")
    for n, e in np.random.default_rng(1).uniform(-300.0, 300.0, (60, 2)):
        assert floor.range_m((float(n), float(e), -9.0), (0.0, 0.0, 1.0)) == pytest.approx(9.0, abs=1e-4)


def test_places_are_free(scene: Scene) -> None:
    solids, places = Solids(standing(scene)), blocks.places(1)
    assert len(places.spots) > 1500
    for spot in places.spots[::17]:
        n, e, d = spot.position_ned
        assert d == 0.0
        assert solids.clearance_m((n, e, -1.0)) >= blocks.SPOT_CLEAR_M - 1e-6
    assert len(places.lanes) >= 4
    for lane in places.lanes:
        assert lane.length_m >= 48.0
        for n, e, d in lane.waypoints_ned[::3]:
            assert solids.clearance_m((n, e, d - 1.0)) >= lane.width_m / 2 - 1e-6


def test_every_shipped_map_lists_its_places() -> None:
    for name in maps.shipped():
        places = maps.places(name)
        assert places.spots
        assert places.lanes
        assert places.landmarks or name != "campus"
    with pytest.raises(UsageError, match="campus"):
        maps.places("nowhere")


def arrangement(rng: np.random.Generator, spots: NDArray[np.float64], solids: Solids) -> bool:
    """Place four signs and a start grid at random, and return whether a commanding episode can use them."""
    grid = spots[rng.integers(len(spots))]
    near = spots[np.linalg.norm(spots - grid, axis=1) < TO_EACH[1]]
    signs = near[rng.integers(len(near), size=4)]
    gaps = [math.dist(a, b) for a, b in itertools.combinations(signs, 2)]
    reach = [math.dist(grid, s) for s in signs]
    if not (NEAREST[0] <= min(gaps) <= NEAREST[1] and WIDEST[0] <= max(gaps) <= WIDEST[1]):
        return False
    if not (TO_NAMED[0] <= reach[0] <= TO_NAMED[1] and min(reach) >= TO_EACH[0]):
        return False
    bearings = np.unwrap([math.atan2(e - grid[1], n - grid[0]) for n, e in signs])
    if np.ptp(bearings) > math.radians(80.0):  # one picture must show all signs
        return False
    boards = np.column_stack([signs, np.full(4, -1.4)])
    for dn, de in itertools.product((-1.0, 1.0), repeat=2):
        eye: Vec3 = (float(grid[0] + dn), float(grid[1] + de), -EYE_M)
        if solids.hidden(eye, boards).any():
            return False
    return True


@pytest.mark.parametrize("seed", [1, 4])
def test_the_map_has_room_for_commanding_episodes(seed: int) -> None:
    """A seeded random search finds at least two arrangements in each quadrant of the map."""
    rng = np.random.default_rng(seed)
    places = blocks.places(seed)
    solids = Solids(standing(maps.build("blocks", seed)))
    for north, east in itertools.product((-1, 1), repeat=2):
        spots = np.array(
            [s.position_ned[:2] for s in places.spots if s.position_ned[0] * north > 0 < s.position_ned[1] * east]
        )
        arrangements = sum(arrangement(rng, spots, solids) for _ in range(3000))
        assert arrangements >= 2, (north, east)


def test_same_seed_same_blocks(scene: Scene) -> None:
    again, other = maps.build("blocks", 1), maps.build("blocks", 2)
    for a, b in zip(scene.instances, again.instances, strict=True):
        assert (a.name, a.position_ned, a.yaw) == (b.name, b.position_ned, b.yaw)
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
    assert any(
        len(a.mesh.vertices) != len(b.mesh.vertices) for a, b in zip(scene.instances, other.instances, strict=True)
    )
