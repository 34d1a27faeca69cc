"""The map `campus`: many identical objects that stand on the ground and do not overlap, and clear lanes."""

import itertools
import math
from collections import Counter

import numpy as np
import pytest

from episodes import maps
from episodes.maps import assets, campus, campus_ground, campus_plan
from episodes.maps.assets import materials
from episodes.maps.scene import Instance, Scene, turn
from episodes.world.visibility import Solids
from tests.episodes.maps.map_plan import apart, foot

BUDGET = 250_000
MANY: tuple[str, ...] = (
    "bench",
    "lamp",
    "bin",
    "bike-rack",
    "fountain",
    "statue",
    "bollard",
    "kiosk",
    "vending-machine",
)
MANY += ("notice-board", "planter", "picnic-table", "tree", "conifer", "delivery-robot", "service-cart", "person")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return maps.build("campus", 1)


def standing(scene: Scene) -> list[Instance]:
    return [i for i in scene.instances if i.kind not in ("ground", "wood")]


def test_triangle_budget_and_unique_ids_and_names(scene: Scene) -> None:
    assert sum(len(i.mesh.triangles) for i in scene.instances) <= BUDGET
    ids, names = [i.id for i in scene.instances], [i.name for i in scene.instances]
    assert len(set(ids)) == len(ids)
    assert len(set(names)) == len(names)
    assert min(ids) == 1


def test_each_kind_has_at_least_four_objects_with_one_mesh(scene: Scene) -> None:
    count = Counter(i.kind for i in scene.instances)
    assert not {kind: count[kind] for kind in MANY if count[kind] < 4}
    for kind in (*assets.FIXTURES, "delivery-robot", "service-cart"):
        looks = {id(i.mesh) for i in scene.instances if i.kind == kind}
        assert len(looks) == (2 if kind == "fountain" else 1), kind
    for one in standing(scene):
        assert one.name.rsplit("-", 1)[0] == one.kind


def test_people_look_different_and_wear_no_paint_colour(scene: Scene) -> None:
    people = [i for i in scene.instances if i.kind == "person"]
    looks = {frozenset((m.name, m.color) for m in i.mesh.materials) for i in people}
    assert len(looks) == len(people)
    assert len({len(i.mesh.triangles) for i in people}) > len(people) / 2  # they also have different shapes
    paints = {materials.linear(srgb) for name, srgb in materials.PAINTS.items() if name not in materials.SHADES}
    for one in people:
        assert not paints & {m.color for m in one.mesh.materials}


def test_names_and_positions_do_not_depend_on_the_seed(scene: Scene) -> None:
    again, other = maps.build("campus", 1), maps.build("campus", 5)
    for a, b, c in zip(scene.instances, again.instances, other.instances, strict=True):
        assert (a.name, a.position_ned, a.yaw) == (b.name, b.position_ned, b.yaw)
        assert a.mesh is b.mesh or np.array_equal(a.mesh.vertices, b.mesh.vertices)
        assert (a.name, a.position_ned) == (c.name, c.position_ned)
    assert any(a.yaw != c.yaw for a, c in zip(scene.instances, other.instances, strict=True))


def test_no_triangle_is_degenerate(scene: Scene) -> None:
    """The code for distances and collisions divides by a triangle's area."""
    for mesh in {id(i.mesh): i.mesh for i in standing(scene)}.values():
        t = mesh.vertices[mesh.triangles].astype(np.float64)
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        assert area.min() > 1e-9, next(i.name for i in scene.instances if i.mesh is mesh)


def test_drawn_ground_matches_the_height_field(scene: Scene) -> None:
    ground = Solids(i for i in scene.instances if i.kind == "ground")
    rng = np.random.default_rng(3)
    for n, e in rng.uniform(-94.0, 94.0, (400, 2)):
        down = ground.range_m((float(n), float(e), -50.0), (0.0, 0.0, 1.0)) - 50.0
        assert down == pytest.approx(scene.terrain.at(float(n), float(e)), abs=0.005)


def test_ground_pieces_neither_overlap_nor_leave_gaps() -> None:
    """The pieces cover the whole square exactly once. The fields around it are excluded: they reach under its edge."""
    meshes = dict(campus_ground.ground())
    area = 0.0
    for mesh in meshes.values():
        corners = mesh.triangles[np.array([look.name != "fields" for look in mesh.materials])[mesh.material]]
        t = mesh.vertices[corners][..., :2].astype(np.float64)
        a, b = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
        area += float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2)
        assert (mesh.normals[corners.ravel(), 2] < -0.95).all()
    assert area == pytest.approx((2 * campus_ground.FAR[-1]) ** 2, rel=1e-6)


def test_use_at_matches_the_drawn_ground() -> None:
    drawn = {use: Solids([Instance(1, use, "ground", mesh, (0.0, 0.0, 0.0))]) for use, mesh in campus_ground.ground()}
    rng = np.random.default_rng(5)
    for n, e in rng.uniform(-60.0, 60.0, (200, 2)):
        use = campus_ground.use_at(float(n), float(e))
        assert math.isfinite(drawn[use].range_m((float(n), float(e), -50.0), (0.0, 0.0, 1.0)))


def test_everything_stands_on_the_ground(scene: Scene) -> None:
    for one in standing(scene):
        n, e, d = one.position_ned
        if one.kind == "hall":
            continue
        assert d == pytest.approx(scene.terrain.at(n, e), abs=1e-9)
        # Each corner of its footprint is on the ground.
        for corner in foot(one):
            if one.kind not in ("tree", "conifer", "shrub", "clock-tower"):
                assert abs(scene.terrain.at(*corner) - d) < 0.10, one.name


def test_halls_extend_below_the_ground(scene: Scene) -> None:
    for one in scene.instances:
        if one.kind == "hall":
            below = one.position_ned[2] + one.mesh.vertices[:, 2].max()
            for n, e in foot(one):
                assert scene.terrain.at(n, e) < below
                assert scene.terrain.at(n, e) > one.position_ned[2] - 0.45  # the floor is not below the ground


def test_footprints_do_not_overlap(scene: Scene) -> None:
    boxes = [(i.name, foot(i)) for i in standing(scene) if i.kind != "hall"]
    for (a, first), (b, second) in itertools.combinations(boxes, 2):
        assert apart(first, second), f"{a} stands in {b}"


def test_no_object_is_inside_a_hall_or_on_its_steps(scene: Scene) -> None:
    for hall in (i for i in scene.instances if i.kind == "hall"):
        solid = Solids([hall])
        half = next(plan.depth for plan, n, e, _ in campus_plan.HALLS if (n, e) == hall.position_ned[:2]) / 2
        wide = math.hypot(*np.abs(hall.mesh.vertices[:, :2]).max(axis=0))
        for one in (i for i in standing(scene) if i.kind != "hall"):
            if math.dist(one.position_ned[:2], hall.position_ned[:2]) > wide + 3.0:
                continue
            corners = foot(one)
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
                for n, e in (a, (a + b) / 2):
                    local = turn(hall.yaw).T @ (np.array((n, e, 0.0)) - np.array(hall.position_ned))
                    inside = abs(local[0]) < half and abs(local[1]) < -hall.mesh.vertices[:, 1].min()
                    gap = solid.clearance_m((float(n), float(e), one.position_ned[2] - 0.3))
                    assert not inside, f"{one.name} stands in {hall.name}"
                    assert gap > 0.02, f"{one.name} stands in the steps of {hall.name}"


def test_tree_crowns_do_not_reach_into_halls(scene: Scene) -> None:
    halls = [i for i in scene.instances if i.kind == "hall"]
    for tree in (i for i in scene.instances if i.kind in ("tree", "conifer")):
        reach = float(np.linalg.norm(tree.mesh.vertices[:, :2], axis=1).max())
        for hall in halls:
            local = turn(hall.yaw).T @ (np.array(tree.position_ned) - np.array(hall.position_ned))
            low, high = hall.mesh.vertices.min(axis=0), hall.mesh.vertices.max(axis=0)
            gap = np.maximum(np.maximum(low[:2] - local[:2], local[:2] - high[:2]), 0.0)
            assert math.hypot(*gap) > 0.8 * reach, f"{tree.name} grows into {hall.name}"


def test_lanes_are_long_free_and_on_the_ground(scene: Scene) -> None:
    solids = Solids(i for i in scene.instances if i.kind not in ("ground", "wood"))
    lanes = campus.places(1).lanes
    assert len(lanes) >= 8
    for lane in lanes:
        assert lane.length_m >= 48.0, lane.name
        assert len(lane.waypoints_ned) <= 200
        for (n, e, d), (n2, e2, d2) in itertools.pairwise(lane.waypoints_ned):
            assert d == pytest.approx(scene.terrain.at(n, e), abs=1e-4)
            middle = scene.terrain.at((n + n2) / 2, (e + e2) / 2)
            assert (d + d2) / 2 == pytest.approx(middle, abs=0.02)
            for height in (0.4, 1.2, 1.9):
                gap = solids.clearance_m((n, e, d - height))
                assert gap >= lane.width_m / 2, f"{lane.name} at {n:.1f}, {e:.1f}: {gap:.2f} m"


def test_spots_are_free(scene: Scene) -> None:
    solids = Solids(i for i in scene.instances if i.kind not in ("ground", "wood"))
    spots = campus.places(1).spots
    assert len(spots) > 150
    assert {"plaza", "court", "walk", "lawn"} <= {s.place for s in spots}
    for spot in spots[::7]:
        n, e, d = spot.position_ned
        assert d == pytest.approx(scene.terrain.at(n, e), abs=1e-4)
        assert solids.clearance_m((n, e, d - 1.0)) >= campus.SPOT_CLEAR_M - 0.35  # a kiosk's roof overhangs its foot


def test_landmarks_exist_and_have_distinct_phrases(scene: Scene) -> None:
    names = {i.name for i in scene.instances}
    landmarks = campus_plan.LANDMARKS
    assert all(mark.name in names for mark in landmarks)
    assert len({mark.phrase for mark in landmarks}) == len(landmarks) >= 8


def test_fountain_1_is_the_tallest_fountain(scene: Scene) -> None:
    tall = {i.name: -i.mesh.vertices[:, 2].min() for i in scene.instances if i.kind == "fountain"}
    assert max(tall, key=tall.__getitem__) == "fountain-1"
    assert sorted(tall.values())[-1] > 1.5 * sorted(tall.values())[-2]


def test_spawn_is_free(scene: Scene) -> None:
    n, e, d = scene.spawn_ned
    assert d == scene.terrain.at(n, e)
    solids = Solids(i for i in scene.instances if i.kind != "ground")
    assert solids.clearance_m((n, e, d - 1.0)) > 3.0


def test_the_sun_is_in_the_south_east_at_40_to_62_degrees(scene: Scene) -> None:
    north, east, down = scene.sun.toward_ned
    assert math.hypot(north, east, down) == pytest.approx(1.0)
    assert east > 0.1  # in the east, because it is before noon
    assert north < -0.1  # in the south, because the latitude is northern
    assert 40.0 < math.degrees(math.asin(-down)) < 62.0
