"""The drones of a fleet: their drawn size is the collision size, they appear at true positions, and hide targets."""

import itertools
import math

import numpy as np
import pytest

from episodes.camera.renderer import Renderer
from episodes.maps import assets
from episodes.maps.assets.multirotor import X500, multirotor, outline
from episodes.records import catalogue
from episodes.world.fleet import DronePose, Fleet, hovering
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.frames import Vec3, quat_from_euler
from foundation.terrain import OPEN
from vehicles import airframe as airframes
from vehicles.collision import solids_record
from vehicles.multirotor import Multirotor

HALF = CameraModel(640, 360)
RECORDS = ("v1-residential-commanding-01", "v1-blocks-commanding-01")  # their squares of drones face the target


@pytest.fixture(scope="module", params=RECORDS)
def world(request):
    return World(catalogue.load(request.param))


@pytest.fixture(scope="module")
def renderer(world):
    drawn = Renderer(world.filmed, HALF)
    yield drawn
    drawn.close()


def turned(roll, pitch, yaw):
    """Return the (3, 3) rotation from body FRD to NED of Euler angles (rad), computed without `foundation.frames`."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return rz @ ry @ rx


def projected(points, eye_place, eye_turned):
    """Return the pixels (N, 2) and depths (N,) of world points in a drone's picture, with a separate pinhole model."""
    eye = np.array(eye_place) + eye_turned @ np.array(HALF.offset_frd)
    local = (np.asarray(points) - eye) @ eye_turned
    focal = HALF.width / (2.0 * math.tan(math.radians(HALF.hfov_deg / 2)))
    return np.array((HALF.width / 2, HALF.height / 2)) + focal * local[:, 1:] / local[:, :1], local[:, 0]


def around(shape):
    """Return the outermost points (N, 3) of a drone: the rims of its rotor discs, its feet, mast and camera."""
    angles = np.arange(0.0, 2.0 * math.pi, math.pi / 8)
    rims = [(x + shape.radius_m * math.cos(a), y + shape.radius_m * math.sin(a), z) for x, y, z in shape.hubs
            for a in angles]  # fmt: skip
    return np.array([*rims, *shape.touching, HALF.offset_frd])


def test_the_default_outline_is_that_of_the_x500():
    assert outline(airframes.load("x500")) == X500


@pytest.mark.parametrize("name", airframes.names())
def test_the_drawn_body_matches_the_collision_body(name):
    """Each collision ball contains drawn vertices, and all drawn vertices beyond the rotors are in a ball."""
    frame = airframes.load(name)
    mesh = multirotor(outline(frame))
    assert len(mesh.triangles) <= 1500
    corners = mesh.vertices.astype(np.float64)
    solid = solids_record(Multirotor(frame, seed=0, origin=(47.0, 8.0, 400.0)).params, OPEN, HALF.offset_frd)
    balls = solid["ball"][: solid["balls"]]
    gaps = np.linalg.norm(corners[:, None] - balls[None, :, :3], axis=2) - balls[:, 3]
    assert (gaps.min(axis=0) <= 0.0).all()
    body = frame.curve.radius_m + max(math.hypot(*rotor.position_frd) for rotor in frame.rotors)
    far = np.linalg.norm(corners, axis=1) > body + 0.01
    assert (gaps[far].min(axis=1) < 0.0).all()  # the camera and its bumpers
    for rotor in frame.rotors:  # the blades reach the rim
        off = corners - np.array(rotor.position_frd)
        blade = np.abs(off[:, 2]) <= 0.02 * frame.curve.radius_m
        reach = np.linalg.norm(off[blade, :2], axis=1)
        assert np.abs(reach - frame.curve.radius_m).min() < 0.01 * frame.curve.radius_m


def test_drones_are_separate_from_targets_and_candidates(world):
    assert "drone" not in assets.names()
    assert {one.kind for one in world.fleet.instances} == {"drone"}
    assert [one.name for one in world.fleet.instances] == ["drone-0", "drone-1", "drone-2", "drone-3"]
    ids = [one.id for one in world.filmed.instances]
    assert len(ids) == len(set(ids))
    assert not any(one.kind == "drone" for one in world.scene.instances)


def test_a_single_drone_is_not_drawn_and_leaves_the_scene_unchanged():
    alone = World(catalogue.load("residential-approaching-01"))
    assert alone.fleet.instances == ()
    assert alone.filmed.instances == alone.scene.instances
    assert alone.moved(0.0, {}) == {}


def test_a_fleet_has_one_instance_per_drone_but_none_for_a_single_drone():
    start = catalogue.load("residential-approaching-01").starts
    assert len(Fleet(start, 7, X500, 3).instances) == 3
    assert [one.id for one in Fleet(start, 7, X500, 3).instances] == [7, 8, 9]
    assert Fleet(catalogue.load(RECORDS[0]).starts, 7, X500, 1).instances == ()


def test_drones_appear_at_their_pinhole_projections(world, renderer):
    """Fleets have random, tilted poses. For each pair of drones, ids are compared with projected airframe points."""
    rng = np.random.default_rng(4)
    shape, checked, behind = around(X500), 0, 0
    for _ in range(12):
        poses: dict[int, tuple[Vec3, Vec3]] = {}
        for k, start in enumerate(world.record.starts):
            at = np.array(start.position_ned) + rng.uniform((-5.0, -5.0, -3.0), (5.0, 5.0, 0.0))
            (roll, pitch), yaw = rng.uniform(-0.35, 0.35, 2), math.radians(start.yaw_deg) + rng.uniform(-2.0, 2.0)
            place = (float(at[0]), float(at[1]), float(at[2]))
            poses[k] = (place, (float(roll), float(pitch), float(yaw)))
        drone_poses = {k: DronePose(place, quat_from_euler(*tilt)) for k, (place, tilt) in poses.items()}
        for i in poses:
            place, tilt = poses[i]
            eye = camera_pose(place, drone_poses[i].attitude, HALF)
            view = renderer.render(eye, world.moved(0.0, {k: p for k, p in drone_poses.items() if k != i}))
            assert not (view.ids == world.fleet.instances[i].id).any()  # no drone sees itself
            for j in poses:
                if j == i:
                    continue
                points = np.array(poses[j][0]) + shape @ turned(*poses[j][1]).T
                pixels, depth = projected(points, place, turned(*tilt))
                mine = np.argwhere(view.ids == world.fleet.instances[j].id)[:, ::-1] + 0.5
                if (depth < 0.0).all():
                    assert len(mine) == 0
                    behind += 1
                    continue
                inside = (depth > 0.6) & (np.abs(pixels - np.array((320, 180))) < np.array((320, 180))).all(axis=1)
                between = world.past(p for k, p in drone_poses.items() if k not in (i, j))
                if not inside.all() or between.hidden(eye.position_ned, points).any():
                    continue
                low, high = pixels.min(axis=0), pixels.max(axis=0)
                assert len(mine) > 0
                thick = 1.0 + 0.03 * 320.0 / depth.min()  # px: half the camera's housing, represented by one point
                assert (mine.min(axis=0) > low - thick).all()
                assert (mine.max(axis=0) < high + thick).all()
                spread, wanted = np.ptp(mine, axis=0), high - low
                assert (spread > 0.6 * wanted - 3.0).all()
                at = view.depth[view.ids == world.fleet.instances[j].id]
                assert at.min() > depth.min() - 0.02
                assert at.max() < depth.max() + 0.02
                checked += 1
    assert checked >= 15
    assert behind >= 15


def test_rear_drones_see_front_drones_in_their_first_picture(world, renderer):
    starts = world.fleet.starts
    for i, j in itertools.permutations(range(4), 2):
        view = renderer.render(
            camera_pose(starts[i].position_ned, starts[i].attitude, HALF), world.moved(0.0, world.fleet.other_starts(i))
        )
        off = turned(0.0, 0.0, math.radians(world.record.starts[i].yaw_deg)).T @ (
            np.array(starts[j].position_ned) - np.array(starts[i].position_ned)
        )
        pixels = int((view.ids == world.fleet.instances[j].id).sum())
        if off[0] > 1.9 and abs(off[1]) < 0.1:
            assert pixels > 1000
        elif off[0] < 0.5:
            assert pixels == 0


def test_only_a_drone_with_a_pose_is_drawn_and_casts_a_shadow(world, renderer):
    above = world.fleet.starts[0].position_ned
    ground = world.ground_down(*above[:2])
    low = DronePose((above[0], above[1], ground - 0.6), (1.0, 0.0, 0.0, 0.0))
    eye = camera_pose((above[0], above[1], ground - 4.0), quat_from_euler(0.0, -math.pi / 2, 0.0), HALF)
    bare, shown = (renderer.render(eye, world.moved(0.0, drones)) for drones in ({}, {1: low}))
    mine = shown.ids == world.fleet.instances[1].id
    assert 200 < mine.sum() < 8000
    assert not (bare.ids == world.fleet.instances[1].id).any()
    darker = (bare.rgb.mean(axis=2) > shown.rgb.mean(axis=2) + 8.0) & ~mine
    if bare.rgb[mine].mean() > 60.0:  # the place is in the sun
        assert darker.sum() > 50
    again = renderer.render(eye, world.moved(0.0, {}))
    np.testing.assert_array_equal(again.rgb, bare.rgb)


def before_the_lens(world, gap_m, aside_m=0.0):
    """Return the place and attitude of a drone that faces the target at 12 m, and the pose of another drone.

    The other drone is `gap_m` in front of the first one's lens and `aside_m` to the side.
    """
    goal = world.target_centre(0.0)
    start = np.array(world.record.starts[0].position_ned)
    way = np.array(goal) - start
    way /= np.linalg.norm(way)
    yaw, pitch = math.atan2(way[1], way[0]), -math.asin(way[2])
    body = turned(0.0, pitch, yaw)
    attitude = quat_from_euler(0.0, pitch, yaw)
    place = np.array(goal) - 12.0 * way - body @ np.array(HALF.offset_frd)
    other = np.array(goal) - (12.0 - gap_m) * way + body @ np.array((0.0, aside_m, 0.0))
    return tuple(place.tolist()), attitude, DronePose(tuple(other.tolist()), attitude)


def test_a_drone_before_the_lens_hides_the_target_equally_in_rays_and_ids():
    world = World(catalogue.load("v1-blocks-commanding-01"))  # its target is a sign, 1.2 m wide
    camera = CameraModel()
    drawn = Renderer(world.filmed, camera)
    shares = []
    for gap, aside in ((0.35, 0.0), (0.8, 0.0), (0.8, 0.1), (2.0, 0.0), (3.5, 0.1), (2.0, 3.0), (-1.0, 0.0)):
        place, attitude, other = before_the_lens(world, gap, aside)
        eye = camera_pose(place, attitude, camera)
        open_view = drawn.render(eye, world.moved(0.0, {})).ids == world.target_id
        seen = drawn.render(eye, world.moved(0.0, {1: other})).ids == world.target_id
        without = world.measure(0.0, place, attitude, camera)
        m = world.measure(0.0, place, attitude, camera, [other])
        fraction = m.visible_fraction or 0.0
        shares.append(fraction / (without.visible_fraction or math.nan))
        assert seen.sum() / open_view.sum() == pytest.approx(shares[-1], abs=0.04)
        assert m.visible == (fraction >= 0.05)
    drawn.close()
    assert shares[0] == 0.0
    assert 0.05 < shares[1] < 0.9
    assert shares[-2:] == [1.0, 1.0]  # beside the line of sight, and behind the camera


def test_fleet_starts_hover_at_the_recorded_starts(world):
    for start, pose in zip(world.record.starts, world.fleet.starts, strict=True):
        assert pose == hovering(start)
        assert pose.position_ned == start.position_ned
