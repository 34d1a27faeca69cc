"""Compares the target's box in the picture with points sampled on its 3D box, and with the drawn pixels."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from episodes.camera.renderer.renderer import Renderer
from episodes.records import catalogue
from episodes.world.visibility import NEAR_M, in_camera, picture_box
from episodes.world.world import World
from foundation.camera import CameraModel, CameraPose, camera_pose
from foundation.frames import quat_from_euler

CAMERA = CameraModel()
SMALL = CameraModel(width=320, height=180)
turn = st.floats(-math.pi, math.pi)
place = st.tuples(*[st.floats(-8.0, 8.0)] * 3)


def corners(centre, half, attitude):
    """Return a box's corners in camera axes, seen from the origin."""
    pose = CameraPose((0.0, 0.0, 0.0), attitude)
    signs = itertools.product((-1.0, 1.0), repeat=3)
    ned = [tuple(c + s * h for c, s, h in zip(centre, sign, half, strict=True)) for sign in signs]
    return [in_camera(one, pose) for one in ned]


def over_the_edges(box, count=4001):
    """Return points (N, 3) densely along all edges and diagonals of the box."""
    part = np.linspace(0.0, 1.0, count)[:, None]
    each = [np.array(box[a]) + part * (np.array(box[b]) - np.array(box[a])) for a in range(8) for b in range(a)]
    return np.concatenate(each)  # the diagonals lie within the box


@settings(max_examples=60, deadline=None)
@given(place, st.tuples(*[st.floats(0.1, 3.0)] * 3), st.tuples(turn, st.floats(-1.5, 1.5), turn))
def test_picture_box_encloses_the_part_of_the_box_in_front_of_the_camera(centre, half, angles):
    box = corners(centre, half, quat_from_euler(*angles))
    measured_box = picture_box(box, CAMERA)
    points = over_the_edges(box)
    ahead = points[points[:, 0] >= NEAR_M]
    if not len(ahead):
        assert measured_box is None
        return
    across = 500.0 + 500.0 * ahead[:, 1] / ahead[:, 0]  # horizontal field of view: 90°
    under = 500.0 + 500.0 * ahead[:, 2] / ahead[:, 0] * 1280 / 720
    edges = [np.clip(edge, 0.0, 1000.0) for edge in (across.min(), under.min(), across.max(), under.max())]
    if measured_box is None:
        assert edges[2] - edges[0] < 1.0 or edges[3] - edges[1] < 1.0
        return
    if ahead[:, 0].min() > 2.0 * NEAR_M:  # nearer samples are too far apart in the picture
        assert measured_box == pytest.approx(edges, abs=2.0)
    assert measured_box[0] <= edges[0] + 1e-6
    assert measured_box[1] <= edges[1] + 1e-6
    assert measured_box[2] >= edges[2] - 1e-6
    assert measured_box[3] >= edges[3] - 1e-6
    assert 0.0 <= measured_box[0] < measured_box[2] <= 1000.0
    assert 0.0 <= measured_box[1] < measured_box[3] <= 1000.0


def test_targets_behind_or_beside_the_camera_have_no_box():
    level = quat_from_euler(0.0, 0.0, 0.0)
    assert picture_box(corners((-6.0, 0.0, 0.0), (1.0, 1.0, 1.0), level), CAMERA) is None
    assert picture_box(corners((6.0, 9.0, 0.0), (1.0, 1.0, 1.0), level), CAMERA) is None
    assert picture_box(corners((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), level), CAMERA) == (0.0, 0.0, 1000.0, 1000.0)


@pytest.fixture(scope="module")
def world() -> World:
    return World(catalogue.load("blocks-commanding-01"))


def test_measured_target_box_matches_the_drawn_pixels(world):
    renderer = Renderer(world.scene, SMALL)
    goal, rng = world.target_centre(0.0), np.random.default_rng(3)
    boxes = 0
    for _ in range(12):
        towards, reach = rng.uniform(-math.pi, math.pi), rng.uniform(4.0, 9.0)
        spot = (
            goal[0] + reach * math.cos(towards),
            goal[1] + reach * math.sin(towards),
            goal[2] - rng.uniform(0.0, 3.0),
        )
        yaw = math.atan2(goal[1] - spot[1], goal[0] - spot[0]) + rng.uniform(-0.6, 0.6)
        attitude = quat_from_euler(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), yaw)
        measures = world.measure(0.0, spot, attitude, SMALL)
        rows, columns = np.nonzero(renderer.render(camera_pose(spot, attitude, SMALL), {}).ids == world.target_id)
        if not len(rows):
            continue
        drawn = [columns.min() / 0.32, rows.min() / 0.18, (columns.max() + 1) / 0.32, (rows.max() + 1) / 0.18]
        assert measures.target_box is not None
        x0, y0, x1, y1 = measures.target_box
        assert x0 - 4.0 <= drawn[0] < drawn[2] <= x1 + 4.0
        assert y0 - 6.0 <= drawn[1] < drawn[3] <= y1 + 6.0
        forward, right, down = measures.target_frd
        if measures.visible_fraction > 0.99:  # nothing hidden or cut: the box is as large as the drawn target
            boxes += 1
            assert (drawn[2] - drawn[0]) / (x1 - x0) > 0.6
            assert (drawn[3] - drawn[1]) / (y1 - y0) > 0.6
            assert x0 < 500.0 + 500.0 * right / forward < x1
            assert y0 < 500.0 + 500.0 * down / forward * 16 / 9 < y1
    assert boxes >= 2


def test_target_has_no_box_if_the_camera_looks_away(world):
    start = world.record.starts[0]
    goal = world.target_centre(0.0)
    away = math.atan2(goal[1] - start.position_ned[1], goal[0] - start.position_ned[0]) + math.pi
    measures = world.measure(0.0, start.position_ned, quat_from_euler(0.0, 0.0, away), CAMERA)
    assert measures.target_box is None
    assert measures.target_frd[0] < 0.0
    assert math.hypot(*measures.target_frd) == pytest.approx(measures.distance_m, abs=0.6)
