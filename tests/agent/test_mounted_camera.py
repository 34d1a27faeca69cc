"""A pitched camera: projection of a place and back-projection of its pixel are inverse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement, plan
from dronecats.agent.steady.leg import seen_place
from foundation.camera import CameraModel, camera_on, camera_pose
from foundation.camera_mount import CameraMount, GimbalLimits
from foundation.frames import quat_from_euler
from foundation.protocol import POINT_SPAN
from foundation.setpoints import PicturePose, Velocity
from tests.agent.steady.projection import point_of

ANGLES = st.floats(-80.0, 60.0)


def picture_of(forward, right, down, pitch_deg, camera):
    """Return the go (point and depth) of a place in body axes, m from the lens, by the rotation matrix alone."""
    t = math.radians(pitch_deg)
    ahead, below = np.array([[math.cos(t), -math.sin(t)], [math.sin(t), math.cos(t)]]) @ (forward, down)
    x = camera.width / 2 + camera.focal_px * right / ahead
    y = camera.height / 2 + camera.focal_px * below / ahead
    return ahead, Go(x * POINT_SPAN / camera.width, y * POINT_SPAN / camera.height, ahead)


@given(ANGLES, st.floats(2.0, 50.0), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_back_projection_of_pixel_and_depth_returns_the_place(pitch_deg, forward, right, down):
    camera = CameraModel(pitch_deg=pitch_deg)
    ahead, go = picture_of(forward, right, down, pitch_deg, camera)
    if ahead < 0.5:
        return
    assert displacement(go, camera) == pytest.approx((right, forward, -down), abs=1e-6)


def test_the_vehicle_descends_to_a_target_below_but_not_to_a_level_target():
    camera = CameraModel(pitch_deg=-30.0)
    _, below = picture_of(20.0, 0.0, 10.0, -30.0, camera)
    (move,) = plan(below, camera)
    assert isinstance(move.setpoint, Velocity)
    assert move.setpoint.up == pytest.approx(-0.5 * move.setpoint.forward)
    _, level = picture_of(20.0, 0.0, 0.0, -30.0, camera)
    (move,) = plan(level, camera)
    assert isinstance(move.setpoint, Velocity)
    assert move.setpoint.up is None


@given(ANGLES, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.booleans())
def test_the_steady_agents_projection_matches_the_mounted_camera(pitch_deg, roll, pitch, gimballed):
    mount = CameraMount(pitch_deg=pitch_deg, gimbal=GimbalLimits() if gimballed else None)
    camera, angle = camera_on(mount), math.radians(pitch_deg) if gimballed else None
    sight = PicturePose((10.0, -5.0, -3.0), 0.7, roll, pitch, angle)
    attitude = quat_from_euler(roll, pitch, 0.7)
    pose = camera_pose(sight.position_ned, attitude, camera)
    go = Go(430.0, 610.0, 12.0)
    place = seen_place(go, sight, camera)
    assert place.lens_ned == pytest.approx(pose.position_ned)
    back = point_of(place.place_ned, sight, camera)
    assert (back.x, back.y, back.depth_m) == pytest.approx((go.x, go.y, go.depth_m))
