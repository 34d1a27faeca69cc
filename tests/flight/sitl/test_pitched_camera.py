"""Cameras that do not look level: their pictures, and the logger's measurements in them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dronecats.agent.action import Go
from dronecats.agent.controller import displacement
from dronecats.flight.sitl.camera import WorldCamera
from dronecats.flight.sitl.episode_world import origin
from dronecats.flight.sitl.simulation import BootPose, SimulatedVehicle
from episodes.camera.renderer import Renderer
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose
from foundation.camera_mount import CameraMount, GimbalLimits
from foundation.frames import quat_from_euler, rotate
from foundation.mavlink import Packer
from foundation.protocol import POINT_SPAN
from foundation.truth import NewestTruth, gimbal_message, truth_message
from vehicles import airframe


def test_a_gimbal_boots_at_the_pitch_of_its_mounting():
    frame = airframe.load("x500")
    for pitch_deg in (0.0, -10.0, 25.0):
        mount = CameraMount(pitch_deg=pitch_deg, gimbal=GimbalLimits())
        place, reference = BootPose((2.0, -3.0, 0.0), 1.0), (47.4, 8.5, 488.0)
        vehicle = SimulatedVehicle(0, replace(frame, camera=mount), place, seed=4, origin=reference)
        truth = NewestTruth(reference)
        truth.feed(vehicle.truth())
        sample = truth.of(0)
        assert sample is not None
        assert sample.gimbal_pitch == pytest.approx(math.radians(pitch_deg), abs=1e-6)
        vehicle.close()


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load("residential-approaching-01"))


def above_target(world, back=6.0, up=6.0):
    """Return a position behind and above the target, and the heading towards it."""
    n, e, d = world.target_centre(0.0)
    return (n - back, e, d - up), 0.0


@pytest.mark.parametrize("pitch_deg", [-30.0, -55.0])
def test_a_go_to_a_pixel_of_the_target_reaches_the_target(world, pitch_deg):
    """Compares ids and depths of the renderer with the target's position, independently of the tested geometry."""
    place, yaw = above_target(world)
    camera = CameraModel(320, 180, pitch_deg=pitch_deg)
    attitude = quat_from_euler(0.0, 0.0, yaw)
    pose = camera_pose(place, attitude, camera)
    renderer = Renderer(world.scene, camera, 1, shadow_cells=512)
    view = renderer.render(pose, world.moved(0.0))
    renderer.close()
    rows, columns = np.nonzero(view.ids == world.target_id)
    assert len(rows) > 50
    measured = world.measure(0.0, place, attitude, camera)
    assert measured.visible
    ahead, aside, below = measured.target_frd
    seen = columns.mean() + 0.5, rows.mean() + 0.5
    assert camera.width / 2 + camera.focal_px * aside / ahead == pytest.approx(seen[0], abs=0.35 * np.ptp(columns))
    assert camera.height / 2 + camera.focal_px * below / ahead == pytest.approx(seen[1], abs=0.35 * np.ptp(rows))
    half = max(world._half)
    for k in range(0, len(rows), max(len(rows) // 20, 1)):
        y, x = int(rows[k]), int(columns[k])
        go = Go((x + 0.5) * POINT_SPAN / camera.width, (y + 0.5) * POINT_SPAN / camera.height, float(view.depth[y, x]))
        right, forward, up = displacement(go, camera)
        north, east, down = rotate(attitude, (forward, right, -up))
        hit = (pose.position_ned[0] + north, pose.position_ned[1] + east, pose.position_ned[2] + down)
        assert math.dist(hit, world.target_centre(0.0)) < 1.8 * half


def test_the_truth_bus_carries_the_gimbal_attitude_to_the_camera(world):
    place, yaw = above_target(world)
    body, zero = quat_from_euler(0.2, 0.1, yaw), (0.0, 0.0, 0.0)
    pitch = math.radians(-45.0)
    packer = Packer(1, 51)
    data = packer.pack(gimbal_message(1_000_000, quat_from_euler(0.0, pitch, yaw)))
    data += packer.pack(truth_message(1_000_000, place, zero, body, zero, zero, origin(world)))
    truth = NewestTruth(origin(world))
    truth.feed(data)
    sample = truth.of(0)
    assert sample is not None
    assert sample.gimbal_pitch == pytest.approx(pitch, abs=1e-6)
    camera = WorldCamera(world, CameraModel(320, 180, gimballed=True), lambda data: None)
    camera.feed(data)
    level = WorldCamera(world, CameraModel(320, 180, pitch_deg=-45.0), lambda data: None)
    level.feed(packer.pack(truth_message(1_000_000, place, zero, quat_from_euler(0.0, 0.0, yaw), zero, zero,
                                         origin(world))))  # fmt: skip
    gimballed, fixed = camera.newest().image_rgb.astype(float), level.newest().image_rgb.astype(float)
    assert np.abs(gimballed - fixed).mean() < 12.0  # the gimbal keeps the horizon; the lens is off by centimetres
    camera.close()
    level.close()
