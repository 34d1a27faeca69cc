"""The catalogue is complete, varied and accepted by every rule. A world's measurements agree with its pictures."""

import hashlib
import itertools
import math
from collections import Counter

import numpy as np
import pytest

from episodes.authoring.check.referring import RELATIONS
from episodes.authoring.check.rules import check, check_all
from episodes.authoring.check.sight import patch
from episodes.camera.renderer.renderer import Renderer
from episodes.maps import assets
from episodes.maps.assets.materials import SHADES
from episodes.records import catalogue
from episodes.records.record import MOVING
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.frames import Vec3, quat_from_euler

CAMERA, HALF = CameraModel(), CameraModel(640, 360)
FIRST_HUNDRED = "036f8963e2cb1d91ab831c552333d102f5af1fd0532a4baf17400a175a10ba74"
CAP_S = 300.0  # time limit of an episode
WORLDS: dict[str, World] = {}


@pytest.fixture(params=catalogue.QUICK)
def world(request: pytest.FixtureRequest) -> World:
    return WORLDS.setdefault(request.param, World(catalogue.load(request.param)))


@pytest.fixture
def first() -> World:
    return WORLDS.setdefault(catalogue.DEFAULT, World(catalogue.load(catalogue.DEFAULT)))


def level(yaw: float) -> tuple[float, float, float, float]:
    return quat_from_euler(0.0, 0.0, yaw)


def bearing(start: Vec3, goal: Vec3) -> float:
    return math.atan2(goal[1] - start[1], goal[0] - start[0])


def test_the_catalogue_has_ten_episodes_of_each_map_and_cell() -> None:
    records = [catalogue.load(name) for name in catalogue.ids()]
    counted = Counter((r.map, r.cell) for r in records)
    one_drone = ("approaching", "searching", "tracking", "search-and-track")
    wanted = {(place, cell): 10 for place in ("residential", "campus") for cell in one_drone}
    assert counted == {**wanted, ("residential", "commanding"): 10, ("blocks", "commanding"): 10}
    assert {r.id for r in records} == {f"{place}-{cell}-{k:02d}" for place, cell in counted for k in range(1, 11)}
    assert [len(catalogue.suite_ids(name)) for name in ("one-drone", "commanding", "quick", "all", "v1")] == [
        80,
        20,
        12,
        100,
        100,
    ]
    assert {(r.map, r.cell) for r in records if r.id in catalogue.QUICK} == set(counted)


def test_the_first_hundred_episodes_are_unchanged_except_for_their_ids() -> None:
    """Results on these episodes stay comparable. Only the prefix `v1-` of the id is new."""
    assert [f"v1-{name}" for name in catalogue.ids()] == catalogue.v1_ids()
    digest = hashlib.sha256()
    for name in catalogue.v1_ids():
        digest.update((catalogue.V1_FOLDER / f"{name}.json").read_bytes().replace(b'"id": "v1-', b'"id": "', 1))
    assert digest.hexdigest() == FIRST_HUNDRED


def test_targets_are_varied() -> None:
    records = [catalogue.load(name) for name in catalogue.ids()]
    painted = [r.target for r in records if r.map == "residential" and r.cell != "commanding"]
    assert {t.asset for t in painted} == {
        "bus", "cyclist", "hatchback", "motorcycle", "pickup", "quadrotor", "sedan", "suv", "van",
    }  # fmt: skip
    assert {t.paint for t in painted} == set(assets.PAINTS) - set(SHADES)
    campus = [r for r in records if r.map == "campus"]
    assert len({r.target.asset for r in campus if r.target.native}) >= 8
    assert {r.target.asset for r in campus if r.target.path} == {"delivery_robot", "pedestrian", "service_cart"}
    assert min(r.start_distance_m for r in campus) < 14.0
    assert max(r.start_distance_m for r in campus) > 44.0
    relation_counts = Counter(next(how for how in RELATIONS if f" {how} " in r.instruction) for r in campus)
    assert len(relation_counts) >= len(RELATIONS) - 2  # objects behind a landmark are rarely visible
    assert max(relation_counts.values()) < 36
    assert len({(r.instruction, r.cell) for r in records}) > 90


def test_every_rule_accepts_the_quick_suite(world: World) -> None:
    assert [f.sentence for f in check(world) if not f.passed] == []


@pytest.mark.slow
def test_every_rule_accepts_every_episode() -> None:
    assert {r.name: r.reason for r in check_all(catalogue.ids()) if r.reason} == {}


def test_measured_depth_and_pixels_of_a_faced_target_match_the_picture(world: World) -> None:
    start = world.record.starts[0].position_ned
    attitude = level(bearing(start, world.target_centre(0.0)))
    view = Renderer(world.scene, HALF).render(camera_pose(start, attitude, HALF), world.moved(0.0))
    mine = view.ids == world.target_id
    counted = patch(world.target, world.solids, start, attitude, HALF)
    assert counted.pixels == pytest.approx(int(mine.sum()), rel=0.02, abs=2)
    m = world.measure(0.0, start, attitude, HALF)
    assert m.visible
    assert m.oracle_depth_m == pytest.approx(float(np.median(view.depth[mine])), rel=0.05)


def test_moving_targets_move_for_the_whole_episode_and_leave_the_start(world: World) -> None:
    if world.record.cell not in MOVING:
        assert world.moved(10.0) == {}
        return
    path = world.record.target.path
    assert path is not None
    assert path.speed_mps == {"residential": 0.3, "campus": 0.15}[world.record.map]  # paper
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(path.waypoints_ned))
    assert length > path.speed_mps * CAP_S
    assert math.dist(world.target_pose(0.0)[0], world.target_pose(CAP_S)[0]) > 5.0
    assert world.moved(30.0)[world.target_id] == world.target_pose(30.0)


def test_measured_visibility_agrees_with_the_picture(first: World) -> None:
    renderer = Renderer(first.scene, CAMERA)
    goal, rng = first.target_centre(0.0), np.random.default_rng(5)
    for _ in range(12):
        turn, reach = rng.uniform(-math.pi, math.pi), rng.uniform(6.0, 20.0)
        spot = (goal[0] + reach * math.cos(turn), goal[1] + reach * math.sin(turn), -rng.uniform(1.5, 6.0))
        attitude = level(bearing(spot, goal) + rng.uniform(-0.9, 0.9))
        fraction = first.measure(0.0, spot, attitude, CAMERA).visible_fraction or 0.0
        view = renderer.render(camera_pose(spot, attitude, CAMERA), {})
        share = float((view.ids == first.target_id).mean())
        assert (fraction > 0.02) == (share > 1e-4) or abs(fraction - 0.02) < 0.03


def test_distance_and_bearing_to_the_target_and_its_box(first: World) -> None:
    centre = first.target_centre(0.0)
    beside = (centre[0], centre[1] + 4.0, centre[2])
    m = first.measure(0.0, beside, level(-math.pi / 2), CAMERA)
    assert m.distance_m == pytest.approx(4.0)
    assert m.distance_box_m == pytest.approx(2.95, abs=0.15)  # half of the SUV's 1.9 m and its mirror
    assert m.bearing_deg == pytest.approx(0.0, abs=1e-6)
    assert first.measure(0.0, beside, level(0.0), CAMERA).bearing_deg == pytest.approx(-90.0)
    inside = first.measure(0.0, centre, level(0.0), CAMERA)
    assert inside.distance_box_m == 0.0


def test_a_target_behind_the_camera_or_a_house_is_not_visible(first: World) -> None:
    goal = first.target_centre(0.0)
    start = first.record.starts[0].position_ned
    away = first.measure(0.0, start, level(bearing(start, goal) + math.pi), CAMERA)
    assert (away.visible, away.visible_fraction, away.oracle_depth_m) == (False, 0.0, None)
    house = next(i.position_ned for i in first.scene.instances if i.kind == "house")
    beyond = 1.0 + 8.0 / math.dist(house[:2], goal[:2])
    behind = (goal[0] + beyond * (house[0] - goal[0]), goal[1] + beyond * (house[1] - goal[1]), -1.8)
    hidden = first.measure(0.0, behind, level(bearing(behind, goal)), CAMERA)
    assert (hidden.visible_fraction or 0.0) < 0.05
    assert not hidden.visible
    far = first.measure(0.0, (goal[0] - 400.0, goal[1], -2.0), level(0.0), CAMERA)
    assert not far.visible


def test_visible_fraction_falls_gradually_as_the_target_leaves_the_frame(first: World) -> None:
    goal, start = first.target_centre(0.0), first.record.starts[0].position_ned
    ahead = bearing(start, goal)
    parts = [
        first.measure(0.0, start, level(ahead + math.radians(a)), CAMERA).visible_fraction or 0.0
        for a in range(0, 60, 2)
    ]
    assert parts[0] > 0.95
    assert parts[-1] == 0.0
    assert any(0.1 < p < 0.9 for p in parts)
    assert all(b <= a + 0.02 for a, b in itertools.pairwise(parts))


def test_two_worlds_of_a_record_are_the_same(first: World) -> None:
    again = World(first.record)
    assert [i.name for i in again.scene.instances] == [i.name for i in first.scene.instances]
    start = first.record.starts[0]
    attitude = level(math.radians(start.yaw_deg))
    assert again.measure(3.0, start.position_ned, attitude, CAMERA) == first.measure(
        3.0, start.position_ned, attitude, CAMERA
    )


def test_clearance_is_a_distance(first: World) -> None:
    assert first.clearance_m((0.0, 0.0, first.ground_down(0.0, 0.0) - 2.0)) == pytest.approx(2.0, abs=0.01)
    rng = np.random.default_rng(2)
    for _ in range(10):
        a = (float(rng.uniform(-50, 50)), float(rng.uniform(-30, 30)), -float(rng.uniform(1, 6)))
        step = rng.normal(size=3) * 0.3
        b = (a[0] + float(step[0]), a[1] + float(step[1]), a[2] + float(step[2]))
        assert abs(first.clearance_m(a) - first.clearance_m(b)) <= math.dist(a, b) + 1e-9
        # no ray hits anything nearer than the clearance
        for direction in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)):
            assert first.solids.range_m(a, direction) >= first.clearance_m(a) - 1e-3


def test_measurement_and_renderer_agree_on_a_pitched_camera(first: World) -> None:
    """A pitched attitude moves the target in the picture. `measure` and the renderer must agree on the direction."""
    goal = first.target_centre(0.0)
    spot = (goal[0] - 9.0, goal[1], goal[2] - 6.0)
    down, up = quat_from_euler(0.0, -0.6, 0.0), quat_from_euler(0.0, 0.6, 0.0)
    seen = [first.measure(0.0, spot, q, CAMERA).visible_fraction or 0.0 for q in (down, up)]
    renderer = Renderer(first.scene, CAMERA)
    drawn = [
        bool(
            (renderer.render(CameraPose(camera_pose(spot, q, CAMERA).position_ned, q), {}).ids == first.target_id).any()
        )
        for q in (down, up)
    ]
    assert [s > 0.5 for s in seen] == drawn
    assert drawn[0] != drawn[1]
