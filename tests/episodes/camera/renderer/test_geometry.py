"""Depth and ids of each pixel equal those of a ray through its middle."""

import math

import numpy as np
import pytest
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from hypothesis import given, settings
from hypothesis import strategies as st

from episodes.camera.renderer import Renderer
from foundation.camera import CameraModel, camera_pose
from foundation.errors import UsageError
from foundation.frames import quat_from_euler, rotate, rotate_inverse
from tests.episodes.camera.renderer.scenes import box_mesh, ground_mesh, instance, looking, random_boxes, scene_of

CAMERA = CameraModel(width=160, height=90)


@pytest.fixture(scope="module")
def dots():
    """A renderer of one movable cube of 0.1 m."""
    cube = instance(1, box_mesh(0.1, 0.1, 0.1), (0, 0, 0), movable=True)
    return Renderer(scene_of([cube]), CAMERA, shadow_cells=64)


def pixel_rays(camera, pose):
    """Return the pixels' ray directions in NED, (H, W, 3), scaled to 1 m along the optical axis."""
    x = (np.arange(camera.width) + 0.5 - camera.width / 2) / camera.focal_px
    y = (np.arange(camera.height) + 0.5 - camera.height / 2) / camera.focal_px
    axes = np.array([rotate(pose.attitude, axis) for axis in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))])
    rays = np.empty((camera.height, camera.width, 3))
    rays[..., 0], rays[..., 1], rays[..., 2] = 1.0, x[None, :], y[:, None]
    return rays @ axes


@pytest.mark.parametrize(
    "pose", [looking((0, 0, -3.0)), looking((5, 2, -30.0), 40, -35, 20), looking((0, 0, -0.2), 90)]
)
def test_depth_of_level_ground_is_analytic(pose):
    view = Renderer(scene_of([instance(1, ground_mesh(), (0, 0, 0), "ground")]), CAMERA, shadow_cells=64).render(pose)
    rays = pixel_rays(CAMERA, pose)
    with np.errstate(divide="ignore"):
        distance = -pose.position_ned[2] / rays[..., 2]
    point = np.array(pose.position_ned) + rays * distance[..., None]
    hit = (distance > 0) & (np.abs(point[..., :2]).max(axis=-1) < 500.0)
    assert hit.any()
    np.testing.assert_array_equal(view.ids, hit.astype(np.int32))
    assert np.isinf(view.depth[~hit]).all()
    np.testing.assert_allclose(view.depth[hit], distance[hit], rtol=1e-5)


def test_ground_below_the_camera_is_clipped_at_the_near_plane():
    """The ground has corners behind the camera and crosses the near plane (0.05 m)."""
    renderer = Renderer(scene_of([instance(1, ground_mesh(), (0, 0, 0), "ground")]), CAMERA, shadow_cells=64)
    for height in (0.01, 0.06, 0.5):
        view = renderer.render(looking((0, 0, -height), 10.0))
        with np.errstate(divide="ignore"):
            depth = height / pixel_rays(CAMERA, looking((0, 0, -height), 10.0))[..., 2]
        lower = (depth > 0.0) & (depth < 400.0) & (np.abs(depth - 0.05) > 1e-6)
        np.testing.assert_array_equal(view.ids[lower] == 1, depth[lower] >= 0.05)
        assert view.depth.min() >= 0.05 - 1e-6


def test_depth_is_planar_not_radial():
    wall = instance(1, box_mesh(2.0, 200.0, 200.0), (11.0, 0, 100.0))
    view = Renderer(scene_of([wall]), CAMERA, shadow_cells=64).render(looking((0, 0, 0)))
    np.testing.assert_allclose(view.depth, 10.0, rtol=1e-5)


@settings(max_examples=25, deadline=None)
@given(
    yaw=st.floats(-180, 180),
    pitch=st.floats(-40, 40),
    roll=st.floats(-30, 30),
    forward=st.floats(1, 40),
    right=st.floats(-0.9, 0.9),
    down=st.floats(-0.5, 0.5),
)
def test_a_point_lands_on_the_predicted_pixel(dots, yaw, pitch, roll, forward, right, down):
    """Inverts the paper's back-projection: p = centre + f · offset / depth."""
    pose = looking((3.0, -4.0, -20.0), yaw, pitch, roll)
    offset = rotate(pose.attitude, (forward, right * forward, down * forward))
    center = tuple(p + o for p, o in zip(pose.position_ned, offset, strict=True))
    below = (center[0], center[1], center[2] + 0.05)  # the dot's origin is at its foot
    view = dots.render(pose, {1: (below, 0.0)})
    rows, columns = np.nonzero(view.ids == 1)
    u = CAMERA.width / 2 + CAMERA.focal_px * right
    v = CAMERA.height / 2 + CAMERA.focal_px * down
    half = 0.0867  # m, from the cube's middle to a corner; off the axis, nearer corners appear farther out
    reach = half * (1.0 + max(abs(right), abs(down))) / (forward - half) * CAMERA.focal_px + 1.0
    if 0.1 / forward * CAMERA.focal_px > 1.5 and reach < v < CAMERA.height - reach:
        assert len(rows)
    assert (np.abs(columns + 0.5 - u) <= reach).all()
    assert (np.abs(rows + 0.5 - v) <= reach).all()


def embree(scene):
    """Return an Embree scene of the same triangles, and the instance id of each triangle."""
    corners, ids = [], []
    for thing in scene.instances:
        c, s = math.cos(thing.yaw), math.sin(thing.yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        v = thing.mesh.vertices.astype(float) @ turn.T + thing.position_ned
        corners.append(v[thing.mesh.triangles].astype(np.float32))
        ids.append(np.full(len(thing.mesh.triangles), thing.id))
    traced = EmbreeScene()
    TriangleMesh(traced, np.concatenate(corners))
    return traced, np.concatenate(ids)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_depth_and_ids_agree_with_embree_rays(seed):
    scene = random_boxes(seed)
    camera = CameraModel(width=320, height=180)
    renderer = Renderer(scene, camera, shadow_cells=64)
    traced, id_of = embree(scene)
    rng = np.random.default_rng(seed)
    for _ in range(4):
        pose = looking(tuple(rng.uniform((-50, -50, -12), (50, 50, -1))), *rng.uniform((-180, -30, -20), (180, 20, 20)))
        view = renderer.render(pose)
        rays = pixel_rays(camera, pose).reshape(-1, 3)
        origin = np.tile(np.array(pose.position_ned), (len(rays), 1)) + 0.05 * rays
        hit = traced.run(origin.astype(np.float32), rays.astype(np.float32), query="INTERSECT", output=True)
        triangle = hit["primID"]
        ids = np.where(triangle >= 0, id_of[triangle], 0)
        agree = ids == view.ids.ravel()
        assert agree.mean() > 0.999
        both = agree & (ids > 0)
        error = np.abs(hit["tfar"][both] + 0.05 - view.depth.ravel()[both])
        assert np.median(error) < 1e-4
        assert (error < 1e-3 * np.maximum(1.0, view.depth.ravel()[both])).mean() > 0.9999


def test_sample_count_changes_neither_depth_nor_ids():
    scene, pose = random_boxes(3), looking((-40, 5, -4), 10, -5, 3)
    coarse, fine = (Renderer(scene, CAMERA, shadow_cells=64, grain=grain).render(pose) for grain in (2, 4))
    np.testing.assert_array_equal(fine.ids, coarse.ids)
    np.testing.assert_allclose(fine.depth, coarse.depth, rtol=1e-5)


def test_a_camera_inside_a_closed_box_sees_its_walls():
    """Back faces of closed surfaces are omitted only if they are not visible."""
    room = instance(1, box_mesh(10.0, 8.0, 6.0), (0.0, 0.0, 0.0), movable=True)
    renderer = Renderer(scene_of([room]), CAMERA, shadow_cells=64)
    for north, distance in ((0.0, 5.0), (-4.99, 9.99), (-5.02, 10.02)):  # in the last case the near plane cuts the wall
        view = renderer.render(looking((north, 0.0, -3.0)))
        assert (view.ids == 1).all()
        assert view.depth[45, 80] == pytest.approx(distance, abs=1e-3)
    moved = renderer.render(looking((0.0, 0.0, -3.0)), {1: ((2.0, 0.0, 0.0), 0.0)})
    assert moved.depth[45, 80] == pytest.approx(7.0, abs=1e-3)
    outside = renderer.render(looking((-20.0, 0.0, -3.0)))
    assert outside.depth[45, 80] == pytest.approx(15.0, abs=1e-3)


def test_the_camera_is_ahead_of_and_below_the_body():
    attitude = quat_from_euler(0.1, -0.2, 2.0)
    pose = camera_pose((1.0, 2.0, -3.0), attitude, CameraModel())
    north, east, down = pose.position_ned
    assert rotate_inverse(attitude, (north - 1.0, east - 2.0, down + 3.0)) == pytest.approx((0.5, 0.0, 0.1))
    assert pose.attitude == attitude


def test_ids_must_be_unique():
    twice = [instance(4, box_mesh(1, 1, 1), (0, 0, 0)), instance(4, box_mesh(1, 1, 1), (5, 0, 0))]
    with pytest.raises(UsageError, match=r"'test'.* ids "):
        Renderer(scene_of(twice), CAMERA, shadow_cells=64)
