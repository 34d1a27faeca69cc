"""Places for episodes on the map `residential`: lanes around a block, free kerbs and drives, clear lanes."""

import itertools
import math

import numpy as np
import pytest

from episodes import maps
from episodes.maps import residential_plan as plan
from episodes.maps.assets.vehicles import SHAPES
from episodes.maps.residential_places import places
from episodes.maps.scene import Lane, Places, Scene, Spot, turn
from episodes.world.visibility import Solids

TARGET_M, SPEED_MPS, CAP_S = 16.0, 0.3, 300.0  # paper: residential map
NEAREST_M, WIDEST_M = (5.5, 11.2), (18.0, 32.0)  # paper: candidates
KEPT: dict[str, tuple[Scene, Places, Solids]] = {}


def town() -> tuple[Scene, Places, Solids]:
    if not KEPT:
        scene = maps.build("residential", 1)
        KEPT["1"] = scene, places(1), Solids(i for i in scene.instances if i.kind != "ground")
    return KEPT["1"]


def test_drawn_ground_matches_the_height_field_everywhere() -> None:
    scene, _, _ = town()
    ground = Solids(i for i in scene.instances if i.kind == "ground")
    rng = np.random.default_rng(3)
    n0, n1, e0, e1 = plan.REACH
    for n, e in zip(rng.uniform(n0, n1, 500), rng.uniform(e0, e1, 500), strict=True):
        if 3.7 < plan.away(np.array([n]), np.array([e]))[0] < 4.6:
            continue  # the kerb's vertical face is between the nodes of both grids
        down = scene.terrain.at(float(n), float(e))
        assert ground.range_m((float(n), float(e), -50.0), (0.0, 0.0, 1.0)) - 50.0 == pytest.approx(down, abs=0.02)


def test_roads_have_no_steps_and_only_cars_stand_on_them() -> None:
    scene, _, _ = town()
    homes = plan.plots(1)
    for street in plan.STREETS:
        along = np.arange(street.ends[0] + 4.0, street.ends[1] - 4.0, 0.5)
        level = np.array([scene.terrain.at(*street.at(float(a), 0.0)) for a in along])
        assert np.abs(np.diff(level)).max() < 0.05  # no step between streets, no steep hill
        assert np.allclose(plan.away(*np.array([street.at(float(a), 0.0) for a in along]).T), 0.0)
    assert len({p.street.name for p in homes}) == 4
    for one in scene.instances:
        if one.kind == "ground":
            continue
        n, e, _ = one.position_ned
        if plan.away(np.array([n]), np.array([e]))[0] < 4.0:
            assert one.kind in SHAPES, one.name
    for one in (i for i in scene.instances if i.kind in ("tree", "conifer", "lamp", "mailbox", "hydrant")):
        n, e, _ = one.position_ned
        assert scene.terrain.at(n, e) == one.position_ned[2]


def test_houses_do_not_overlap_each_other_or_trees() -> None:
    scene, _, _ = town()
    boxes = []
    for one in scene.instances:
        if one.kind == "house":
            flat = (one.mesh.vertices @ turn(one.yaw).T + np.array(one.position_ned))[:, :2]
            boxes.append((flat.min(axis=0), flat.max(axis=0)))
    for (a0, a1), (b0, b1) in itertools.combinations(boxes, 2):
        assert (a1 < b0).any() or (b1 < a0).any()
    for one in scene.instances:
        if one.kind in ("tree", "conifer", "lamp"):
            spot = np.array(one.position_ned[:2])
            assert not any(((spot > low) & (spot < high)).all() for low, high in boxes)


def inside(spot: Spot, length: float, width: float, heights: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """Return NED points at `heights` above a rectangle that is centred at a spot."""
    c, s = math.cos(spot.yaw), math.sin(spot.yaw)
    n, e, d = spot.position_ned
    return [
        (n + c * x - s * y, e + s * x + c * y, d - z)
        for x in (-length / 2, -length / 4, 0.0, length / 4, length / 2)
        for y in (-width / 2, 0.0, width / 2)
        for z in heights
    ]


@pytest.mark.parametrize(
    ("place", "size", "least"),
    [("kerb", (4.9, 2.0), 45), ("drive", (4.9, 2.0), 30), ("bus stop", (10.4, 2.4), 3), ("lawn", (1.6, 1.6), 50)],
)
def test_spots_are_free_and_on_the_ground(place: str, size: tuple[float, float], least: int) -> None:
    scene, room, solids = town()
    spots = [s for s in room.spots if s.place == place]
    assert len(spots) >= least
    for spot in spots:
        n, e, d = spot.position_ned
        assert d == pytest.approx(scene.terrain.at(n, e), abs=1e-3)
        assert all(solids.clearance_m(p) > 0.15 for p in inside(spot, *size, (0.4, 1.3)))


def test_at_least_70_kerbs_and_drives_have_a_start_with_a_clear_view() -> None:
    scene, room, solids = town()
    clear_count = 0
    for spot in (s for s in room.spots if s.place in ("kerb", "drive")):
        n, e, d = spot.position_ned
        goal = np.array((n, e, d - 0.8))
        for around in np.arange(0.0, 2 * math.pi, math.pi / 12):
            start = (n + TARGET_M * math.cos(around), e + TARGET_M * math.sin(around))
            eye = (*start, scene.terrain.at(*start) - 1.7)
            way = goal - np.array(eye)
            free = not solids.hidden(eye, (np.array(eye) + 0.9 * way)[None])[0] and solids.clearance_m(eye) > 0.7
            if free and plan.away(np.array([start[0]]), np.array([start[1]]))[0] < 7.0:
                clear_count += 1
                break
    assert clear_count >= 70  # more than the fifty episodes need


def shifted(lane: Lane, aside: float) -> np.ndarray:
    """Return the points (N, 2) of a lane, shifted `aside` metres to its right."""
    points = np.array(lane.waypoints_ned)[:, :2]
    way = np.gradient(points, axis=0)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return points + aside * np.column_stack([-way[:, 1], way[:, 0]])


def test_lanes_are_long_clear_and_on_the_ground() -> None:
    scene, room, solids = town()
    assert len(room.lanes) >= 50
    assert len({lane.name for lane in room.lanes}) == len(room.lanes)
    for lane in room.lanes:
        assert lane.length_m > SPEED_MPS * CAP_S + 10.0
        assert len(lane.waypoints_ned) <= 200
        for a, b in itertools.pairwise(np.array(lane.waypoints_ned)):
            for share in (0.0, 0.25, 0.5, 0.75):
                n, e, d = a + share * (b - a)
                assert d == pytest.approx(scene.terrain.at(float(n), float(e)), abs=0.02)
        for aside in (-lane.width_m / 2, 0.0, lane.width_m / 2):
            edge = shifted(lane, aside)
            for (n0, e0), (n1, e1) in itertools.pairwise(edge):
                for up in (0.35, 1.0, 1.6):
                    start = (float(n0), float(e0), scene.terrain.at(float(n0), float(e0)) - up)
                    end = (float(n1), float(e1), scene.terrain.at(float(n1), float(e1)) - up)
                    assert not solids.hidden(start, np.array([end]))[0], lane.name


def test_lanes_leave_drives_and_circle_the_block_in_both_directions() -> None:
    _, room, _ = town()
    names = [lane.name for lane in room.lanes]
    for words in ("anticlockwise", "block, clockwise", "from drive", "to the left", "to the right", "pavement", "Road"):
        assert sum(words in name for name in names) >= 4, words
    rises = []
    for lane in (one for one in room.lanes if one.name.startswith("from drive")):
        start = lane.waypoints_ned[0]
        rises.append(max(p[2] for p in lane.waypoints_ned[:40]) - start[2])
    assert min(rises) > 0.3  # down goes from −0.45 m at the drive to +0.05 m on the road, with a margin for the hill
    turns = []
    for lane in (one for one in room.lanes if "block" in one.name):
        way = np.diff(np.array(lane.waypoints_ned)[:, :2], axis=0)
        course = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
        assert np.abs(np.diff(course)).max() < math.radians(40.0)
        turns.append((course[-1] - course[0]) > 1.0 if "anti" not in lane.name else (course[-1] - course[0]) < -1.0)
    assert sum(turns) >= 0.6 * len(turns)


def test_at_least_12_disjoint_sets_of_four_candidates_fit() -> None:
    """Candidates have the paper's distances and stand only on free kerbs and drives. No spot is used twice."""
    _, room, _ = town()
    spots = [s.position_ned for s in room.spots if s.place in ("kerb", "drive")]
    used: set[int] = set()
    fleets = 0
    for first in range(len(spots)):
        near = [k for k in range(len(spots)) if k not in used and math.dist(spots[k], spots[first]) < WIDEST_M[1]]
        if first in used or len(near) < 4:
            continue
        for four in itertools.combinations(near[:12], 4):
            apart = [math.dist(spots[a], spots[b]) for a, b in itertools.combinations(four, 2)]
            if NEAREST_M[0] <= min(apart) <= NEAREST_M[1] and WIDEST_M[0] <= max(apart) <= WIDEST_M[1]:
                used |= set(four)
                fleets += 1
                break
    assert fleets >= 12


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_other_seeds_give_different_places_with_similar_room(seed: int) -> None:
    scene, room = maps.build("residential", seed), places(seed)
    assert sum(len(i.mesh.triangles) for i in scene.instances) <= 250_000
    mine = [s for s in room.spots if s.place in ("kerb", "drive")]
    assert len(mine) >= 60
    assert len(room.lanes) >= 40
    assert places(seed) == room
    assert room != town()[1]
