"""Compares frames and units with independent computations: rotation matrices, and scipy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dronecats.report.export.conventions import (
    enu,
    flu,
    lon_lat_alt,
    microseconds,
    nanoseconds,
    optical_in_flu,
    xyzw_flu_to_enu,
)
from foundation.camera import CameraModel
from foundation.frames import quat_from_euler

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])
ANGLES = st.floats(-math.pi, math.pi)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_an_attitude_turns_flu_into_enu(roll, pitch, yaw):
    ned_of_frd = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    expected = NED_TO_ENU @ ned_of_frd @ FLU_TO_FRD
    quaternion = xyzw_flu_to_enu(quat_from_euler(roll, pitch, yaw))
    assert quaternion[3] >= 0.0
    np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), expected, atol=1e-9)


def test_directions_in_the_body_frame_map_to_the_world_frame():
    east = Rotation.from_quat(xyzw_flu_to_enu(quat_from_euler(0.0, 0.0, math.radians(90.0))))  # the nose points east
    np.testing.assert_allclose(east.apply([1.0, 0.0, 0.0]), enu((0.0, 1.0, 0.0)), atol=1e-12)
    np.testing.assert_allclose(east.apply([0.0, 1.0, 0.0]), enu((1.0, 0.0, 0.0)), atol=1e-12)  # left of it is north
    np.testing.assert_allclose(east.apply([0.0, 0.0, 1.0]), enu((0.0, 0.0, -1.0)), atol=1e-12)
    np.testing.assert_array_equal(flu((0.5, 0.2, 0.1)), (0.5, -0.2, -0.1))


def test_optical_axes_point_right_down_and_forward():
    optical = Rotation.from_quat(optical_in_flu(CameraModel()))
    np.testing.assert_allclose(optical.apply([1.0, 0.0, 0.0]), (0.0, -1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(optical.apply([0.0, 1.0, 0.0]), (0.0, 0.0, -1.0), atol=1e-12)
    np.testing.assert_allclose(optical.apply([0.0, 0.0, 1.0]), (1.0, 0.0, 0.0), atol=1e-12)
    lowered = Rotation.from_quat(optical_in_flu(CameraModel(pitch_deg=-90.0)))
    np.testing.assert_allclose(lowered.apply([0.0, 0.0, 1.0]), (0.0, 0.0, -1.0), atol=1e-12)
    np.testing.assert_allclose(lowered.apply([1.0, 0.0, 0.0]), (0.0, -1.0, 0.0), atol=1e-12)


@given(st.integers(0, 10**11))
def test_times_are_exact_to_the_microsecond(time_us):
    assert microseconds(time_us / 1e6) == time_us
    assert nanoseconds(time_us / 1e6) == 1000 * time_us


@pytest.mark.parametrize("latitude", [-33.0, 0.0, 46.5185])
def test_geographic_positions_keep_the_distance_and_direction_in_metres(latitude):
    """Compares longitude, latitude and the distance with spherical trigonometry."""
    longitude, result_lat, altitude = lon_lat_alt((latitude, 6.5669, 394.0), (300.0, -400.0, -20.0))
    assert altitude == 414.0
    a, b = math.radians(latitude), math.radians(result_lat)
    turn = math.radians(longitude - 6.5669)
    between = math.acos(math.sin(a) * math.sin(b) + math.cos(a) * math.cos(b) * math.cos(turn)) * 6371000.0
    assert between == pytest.approx(500.0, abs=0.05)
    assert result_lat > latitude
    assert longitude < 6.5669
    assert (b - a) * 6371000.0 == pytest.approx(300.0, abs=0.05)
