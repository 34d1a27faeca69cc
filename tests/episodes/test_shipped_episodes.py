"""The checks an episode must pass before it ships (paper, appendix "Maps and Episodes"), and what a world measures."""

import itertools
import math

import numpy as np
import pytest

from dronecats.border.camera import CameraModel, CameraPose
from dronecats.border.frames import Vec3, quat_from_euler
from episodes import catalogue
from episodes.record import HIDDEN, MOVING
from episodes.render.pose import camera_pose
from episodes.render.renderer import Renderer
from episodes.world import World

CAMERA = CameraModel()
CAP_S = 300.0  # an episode's longest time
BODY_M = 0.45  # half the diagonal of the vehicle with its propellers
WORLDS: dict[str, World] = {}


@pytest.fixture(params=catalogue.ids())
def world(request: pytest.FixtureRequest) -> World:
    return WORLDS.setdefault(request.param, World(catalogue.load(request.param)))


@pytest.fixture
def first() -> World:
    return WORLDS.setdefault(catalogue.DEFAULT, World(catalogue.load(catalogue.DEFAULT)))


def level(yaw: float) -> tuple[float, float, float, float]:
    return quat_from_euler(0.0, 0.0, yaw)


def bearing(start: Vec3, goal: Vec3) -> float:
    return math.atan2(goal[1] - start[1], goal[0] - start[0])


def test_start_distance_bearing_and_visibility_are_as_recorded(world: World) -> None:
    record, start = world.record, world.record.starts[0]
    m = world.measure(0.0, start.position_ned, level(math.radians(start.yaw_deg)), CAMERA)
    assert m.distance_m == pytest.approx(record.start_distance_m, abs=0.02)
    assert m.distance_m == pytest.approx(16.0, abs=0.2)
    seen_from = math.degrees(bearing(start.position_ned, m.target_ned))
    assert math.remainder(seen_from - record.bearing_deg, 360.0) == pytest.approx(0.0, abs=0.1)
    assert m.visible == record.visible_at_start
    if record.cell in HIDDEN:
        assert m.visible_fraction == 0.0
        assert abs(m.bearing_deg) == pytest.approx(90.0, abs=1.0)
    else:
        assert m.visible_fraction > 0.9


def test_occupancy_and_depth_when_facing_the_target(world: World) -> None:
    start = world.record.starts[0].position_ned
    attitude = level(bearing(start, world.target_centre(0.0)))
    view = Renderer(world.scene, CAMERA).render(camera_pose(start, attitude, CAMERA), world.moved(0.0))
    mine = view.ids == world.target_id
    assert 0.004 <= mine.mean() <= 0.12
    m = world.measure(0.0, start, attitude, CAMERA)
    assert m.visible
    assert m.oracle_depth_m == pytest.approx(float(np.median(view.depth[mine])), rel=0.03)


def test_start_is_free_and_so_is_the_way(world: World) -> None:
    start, goal = world.record.starts[0].position_ned, world.target_centre(0.0)
    ground = world.ground_down(start[0], start[1])
    assert 1.2 <= ground - start[2] <= 2.2
    for up in np.arange(BODY_M + 0.05, 3.01, 0.25):
        assert world.clearance_m((start[0], start[1], ground - float(up))) > BODY_M
    span = math.dist(start, goal)
    for s in np.arange(0.0, span - 5.0, 0.5):  # as far as the radius of success
        point = tuple(a + (b - a) * float(s) / span for a, b in zip(start, goal, strict=True))
        assert world.clearance_m(point) > BODY_M


def test_target_stands_on_the_ground_and_in_nothing(world: World) -> None:
    moves = world.record.cell in MOVING
    for t in np.arange(0.0, CAP_S if moves else 1.0, 20.0):
        place, yaw = world.target_pose(float(t))
        assert place[2] == pytest.approx(world.ground_down(place[0], place[1]), abs=0.06)
        c, s = math.cos(yaw), math.sin(yaw)
        mesh = next(i.mesh for i in world.scene.instances if i.id == world.target_id)
        long = float(mesh.vertices[:, 0].max())
        for x in (-long, 0.0, long):
            for y in (-0.85, 0.85):
                spot = (place[0] + c * x - s * y, place[1] + s * x + c * y, place[2] - 0.9)
                assert world.clearance_m(spot) > 0.1


def test_moving_targets_go_one_way_and_leave_the_start(world: World) -> None:
    if world.record.cell not in MOVING:
        assert world.moved(10.0) == {}
        return
    path = world.record.target.path
    assert path.speed_mps == 0.3  # paper: residential map
    length = sum(math.dist(a, b) for a, b in zip(path.waypoints_ned, path.waypoints_ned[1:], strict=False))
    assert length > path.speed_mps * CAP_S
    start = world.record.starts[0].position_ned
    assert min(math.dist(start, world.target_centre(t)) for t in np.arange(0.0, CAP_S, 5.0)) > 7.0
    assert world.moved(30.0)[world.target_id] == world.target_pose(30.0)


def test_measured_visibility_agrees_with_the_picture(first: World) -> None:
    renderer = Renderer(first.scene, CAMERA)
    goal, rng = first.target_centre(0.0), np.random.default_rng(5)
    for _ in range(12):
        turn, reach = rng.uniform(-math.pi, math.pi), rng.uniform(6.0, 20.0)
        spot = (goal[0] + reach * math.cos(turn), goal[1] + reach * math.sin(turn), -rng.uniform(1.5, 6.0))
        attitude = level(bearing(spot, goal) + rng.uniform(-0.9, 0.9))
        m = first.measure(0.0, spot, attitude, CAMERA)
        view = renderer.render(camera_pose(spot, attitude, CAMERA), {})
        share = float((view.ids == first.target_id).mean())
        assert (m.visible_fraction > 0.02) == (share > 1e-4) or abs(m.visible_fraction - 0.02) < 0.03


def test_distances(first: World) -> None:
    centre = first.target_centre(0.0)
    beside = (centre[0], centre[1] + 4.0, centre[2])
    m = first.measure(0.0, beside, level(-math.pi / 2), CAMERA)
    assert m.distance_m == pytest.approx(4.0)
    assert 2.8 < m.distance_box_m < 3.1  # half of the SUV's 1.9 m and its mirror
    assert m.bearing_deg == pytest.approx(0.0, abs=1e-6)
    assert first.measure(0.0, beside, level(0.0), CAMERA).bearing_deg == pytest.approx(-90.0)
    inside = first.measure(0.0, centre, level(0.0), CAMERA)
    assert inside.distance_box_m == 0.0


def test_looking_away_or_through_a_house_shows_nothing(first: World) -> None:
    goal = first.target_centre(0.0)
    start = first.record.starts[0].position_ned
    away = first.measure(0.0, start, level(bearing(start, goal) + math.pi), CAMERA)
    assert (away.visible, away.visible_fraction, away.oracle_depth_m) == (False, 0.0, None)
    house = next(i.position_ned for i in first.scene.instances if i.kind == "house")
    beyond = 1.0 + 8.0 / math.dist(house[:2], goal[:2])
    behind = (goal[0] + beyond * (house[0] - goal[0]), goal[1] + beyond * (house[1] - goal[1]), -1.8)
    hidden = first.measure(0.0, behind, level(bearing(behind, goal)), CAMERA)
    assert hidden.visible_fraction < 0.05
    assert not hidden.visible
    far = first.measure(0.0, (goal[0] - 400.0, goal[1], -2.0), level(0.0), CAMERA)
    assert not far.visible


def test_leaving_the_frame_loses_the_target_gradually(first: World) -> None:
    goal, start = first.target_centre(0.0), first.record.starts[0].position_ned
    ahead = bearing(start, goal)
    parts = [
        first.measure(0.0, start, level(ahead + math.radians(a)), CAMERA).visible_fraction for a in range(0, 60, 2)
    ]
    assert parts[0] > 0.95
    assert parts[-1] == 0.0
    assert any(0.1 < p < 0.9 for p in parts)
    assert all(b <= a + 0.02 for a, b in itertools.pairwise(parts))


def test_world_is_the_same_every_time(first: World) -> None:
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
        # nothing that a ray meets is nearer than the clearance
        for direction in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)):
            assert first.solids.range_m(a, direction) >= first.clearance_m(a) - 1e-3


def test_the_camera_is_where_the_renderer_puts_it(first: World) -> None:
    """A pitched attitude moves the target in the picture; measure and renderer must agree on which way."""
    goal = first.target_centre(0.0)
    spot = (goal[0] - 9.0, goal[1], goal[2] - 6.0)
    down, up = quat_from_euler(0.0, -0.6, 0.0), quat_from_euler(0.0, 0.6, 0.0)
    seen = [first.measure(0.0, spot, q, CAMERA).visible_fraction for q in (down, up)]
    renderer = Renderer(first.scene, CAMERA)
    drawn = [
        bool(
            (renderer.render(CameraPose(camera_pose(spot, q, CAMERA).position_ned, q), {}).ids == first.target_id).any()
        )
        for q in (down, up)
    ]
    assert [s > 0.5 for s in seen] == drawn
    assert drawn[0] != drawn[1]
