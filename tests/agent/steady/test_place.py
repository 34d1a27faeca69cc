"""The place that a reply points at, from the vehicle's position and attitude when the image was taken."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement, plan
from dronecats.agent.steady.leg import seen_place
from foundation.camera import CameraModel
from foundation.setpoints import PicturePose, Velocity
from tests.agent.steady.projection import point_of

CAMERA = CameraModel()
MIDDLE = Go(500.0, 500.0, 10.0)

angles = st.floats(-0.5, 0.5)
sights = st.builds(
    PicturePose,
    st.tuples(st.floats(-90.0, 90.0), st.floats(-90.0, 90.0), st.floats(-9.0, 0.0)),
    st.floats(-math.pi, math.pi),
    angles,
    angles,
)
points = st.builds(Go, st.floats(0.0, 1000.0), st.floats(0.0, 1000.0), st.floats(2.0, 200.0))


@given(points, sights)
def test_projection_of_a_place_returns_the_point_of_the_reply(go, sight):
    seen = point_of(seen_place(go, sight, CAMERA).place_ned, sight, CAMERA)
    assert (seen.x, seen.y, seen.depth_m) == pytest.approx((go.x, go.y, go.depth_m), abs=1e-6)


@pytest.mark.parametrize(
    ("sight", "place"),
    [
        (
            PicturePose((1.0, 2.0, -3.0), 0.0),
            (11.5, 2.0, -2.9),
        ),  # the lens is 0.5 m ahead of the body and 0.1 m below it
        (PicturePose((1.0, 2.0, -3.0), math.pi / 2.0), (1.0, 12.5, -2.9)),
        (PicturePose((0.0, 0.0, 0.0), 0.0, 0.0, math.pi / 2.0), (0.1, 0.0, -10.5)),  # nose up: above the lens
        (
            PicturePose((0.0, 0.0, 0.0), 0.0, math.pi / 2.0, 0.0),
            (10.5, -0.1, 0.0),
        ),  # right side down: the same line of sight
    ],
)
def test_the_image_centre_is_straight_ahead_of_the_vehicle(sight, place):
    assert seen_place(MIDDLE, sight, CAMERA).place_ned == pytest.approx(place, abs=1e-9)


@given(st.floats(2.0, 4.99), st.floats(440.0, 560.0))
def test_a_short_stride_is_as_long_as_the_papers(depth_m, x):
    go = Go(x, 500.0, depth_m)
    (move,) = plan(go, CAMERA)
    assert isinstance(move.setpoint, Velocity)
    full_length = math.hypot(*displacement(go, CAMERA))
    reach = seen_place(go, PicturePose((0.0, 0.0, 0.0), 0.0), CAMERA).reach
    assert reach * full_length == pytest.approx(move.setpoint.forward * move.duration_s)


def test_the_reach_is_constant_from_5_m_and_zero_below_2_m():
    here = PicturePose((0.0, 0.0, 0.0), 0.0)
    assert [seen_place(Go(500.0, 500.0, depth), here, CAMERA).reach for depth in (5.0, 50.0, 1.99)] == [0.6, 0.6, 0.0]


def test_small_climbs_are_ignored_in_image_and_in_local_coordinates():
    level, nose_down = PicturePose((0.0, 0.0, 0.0), 0.0), PicturePose((0.0, 0.0, 0.0), 0.0, 0.0, -0.1)
    low = Go(500.0, 500.0 + 1000.0 * 0.14 * CAMERA.focal_px / CAMERA.height, 10.0)
    lower = Go(500.0, 500.0 + 1000.0 * 0.2 * CAMERA.focal_px / CAMERA.height, 10.0)
    assert [seen_place(go, level, CAMERA).level for go in (low, lower)] == [True, False]
    assert seen_place(low, nose_down, CAMERA).level  # the pilot meant no descent
    assert seen_place(lower, PicturePose((0.0, 0.0, 0.0), 0.0, 0.0, 0.1), CAMERA).level  # nose up: hardly lower
