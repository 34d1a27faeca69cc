"""The controller has the numbers of the paper's appendix "Execution"."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import Finished, Go, Rotate, Think
from dronecats.agent.controller import displacement, plan
from foundation.camera import CameraModel
from foundation.setpoints import Hold, Turn, Velocity

CAMERA = CameraModel()


def test_focal_length_of_90_degrees_is_half_the_width():
    assert CAMERA.focal_px == pytest.approx(640)


def test_back_projection():
    right, forward, up = displacement(Go(750, 250, 10), CAMERA)
    assert (right, forward, up) == pytest.approx((320 / 640 * 10, 10, 180 / 640 * 10))


def test_straight_ahead_is_a_stride_of_three_metres_in_two_and_a_half_seconds():
    (move,) = plan(Go(500, 500, 20), CAMERA)
    assert move.duration_s == 2.5
    assert isinstance(move.setpoint, Velocity)
    assert move.setpoint.forward == pytest.approx(1.2)
    assert (move.setpoint.up, move.setpoint.bearing) == (None, 0.0)


def test_a_go_beyond_the_deadband_turns_first_and_then_moves_forward():
    right = math.tan(math.radians(20)) * 500 + 500
    turn, move = plan(Go(right, 500, 20), CAMERA)
    angle = pytest.approx(math.radians(20))
    assert isinstance(turn.setpoint, Turn)
    assert isinstance(move.setpoint, Velocity)
    assert turn.setpoint.yaw_rate == pytest.approx(math.radians(60))
    assert turn.setpoint.angle == angle
    assert turn.setpoint.is_before_move
    assert move.setpoint.bearing == angle
    assert turn.duration_s == pytest.approx(20 / 60)
    assert isinstance(move.setpoint, Velocity)


@pytest.mark.parametrize(("bearing_deg", "segments"), [(7.9, 1), (8.1, 2), (-7.9, 1), (-8.1, 2)])
def test_deadband_is_eight_degrees(bearing_deg, segments):
    assert len(plan(Go(500 + 500 * math.tan(math.radians(bearing_deg)), 500, 9), CAMERA)) == segments


@pytest.mark.parametrize(("ratio", "level"), [(0.149, True), (0.151, False)])
def test_small_vertical_components_are_dropped(ratio, level):
    y = 500 - ratio * CAMERA.focal_px / CAMERA.height * 1000
    (move,) = plan(Go(500, y, 12), CAMERA)
    assert isinstance(move.setpoint, Velocity)
    assert (move.setpoint.up is None) == level


@pytest.mark.parametrize(
    ("depth", "speed"), [(5.0, 1.2), (4.99, 0.72), (3.0, 0.72), (2.5, 2.5 * 0.6 / 2.5), (2.0, 0.48)]
)
def test_speed_is_reduced_in_bands_near_the_target(depth, speed):
    (move,) = plan(Go(500, 500, depth), CAMERA)
    assert isinstance(move.setpoint, Velocity)
    assert move.setpoint.forward == pytest.approx(speed, rel=1e-3)


def test_brakes_under_two_metres_but_still_turns():
    (move,) = plan(Go(500, 500, 1.99), CAMERA)
    assert move.setpoint == Hold()
    turn, move = plan(Go(900, 500, 1.0), CAMERA)
    assert isinstance(turn.setpoint, Turn)
    assert move.setpoint == Hold()


@pytest.mark.parametrize("angle", [-200, -90, -1, 30, 90, 215])
def test_rotation_is_a_rate_held_for_a_time(angle):
    (turn,) = plan(Rotate(angle), CAMERA)
    assert isinstance(turn.setpoint, Turn)
    assert turn.setpoint.yaw_rate == pytest.approx(math.copysign(math.radians(60), angle))
    assert turn.duration_s == pytest.approx(abs(angle) / 60)


@pytest.mark.parametrize("action", [Think(), Finished(), Rotate(0), None])
def test_all_other_actions_hold_for_one_step(action):
    (hold,) = plan(action, CAMERA)
    assert hold.setpoint == Hold()
    assert hold.duration_s == 2.5


@given(st.floats(0, 1000), st.floats(0, 1000), st.floats(0, 1e5))
def test_speed_never_exceeds_one_stride_per_step(x, y, depth):
    for segment in plan(Go(x, y, depth), CAMERA):
        assert math.isfinite(segment.duration_s)
        if isinstance(segment.setpoint, Velocity):
            assert math.hypot(segment.setpoint.forward, segment.setpoint.up or 0) <= 1.2 + 1e-9
            assert segment.setpoint.forward >= 0
