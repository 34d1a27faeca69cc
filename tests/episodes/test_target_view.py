"""The measurement casts no rays to targets that are certainly outside the picture. It casts rays to all others."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from episodes.records import catalogue
from episodes.world.visibility import TargetView
from episodes.world.world import World
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler

CAMERA = CameraModel()


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load(catalogue.ids()[0]))


@settings(max_examples=60, deadline=None)
@given(
    away=st.floats(0.5, 25.0), side=st.floats(-math.pi, math.pi), height=st.floats(0.5, 12.0),
    turn=st.floats(-1.2, 1.2), tilt=st.floats(-0.5, 0.5), roll=st.floats(-0.5, 0.5),
)  # fmt: skip
def test_measurements_equal_those_that_always_cast_rays(world, away, side, height, turn, tilt, roll):
    north, east, down = world.target_centre(0.0)
    place = (north + away * math.cos(side), east + away * math.sin(side), down - height)
    attitude = quat_from_euler(roll, tilt, side + math.pi + turn)
    measures = world.measure(0.0, place, attitude, CAMERA)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TargetView, "_beside", lambda *of: False)
        assert world.measure(0.0, place, attitude, CAMERA) == measures


def test_no_ray_is_cast_to_a_target_behind_the_camera(world):
    north, east, down = world.target_centre(0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TargetView, "_in_frame", None)
        assert not world.measure(
            0.0, (north - 15.0, east, down - 1.0), quat_from_euler(0.0, 0.0, math.pi), CAMERA
        ).visible
