"""Depth pictures equal a ray tracer's distances along each pixel. HTTP and in-process depths are the same."""

import threading

import numpy as np
import pytest

from dronecats.flight.sitl.camera import FrameServer
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from episodes.records import catalogue
from episodes.world.rays import NOTHING, RayScene
from episodes.world.world import World
from foundation.camera import CameraModel, camera_pose, decode_depth, encode_depth, in_millimetres
from foundation.errors import CameraError, UsageError
from foundation.frames import quat_from_euler, rotate
from hil.cameras.http import HttpCamera
from tests.flight.sitl.test_frame_size import camera_of


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load("blocks-commanding-01"))


def traced_m(world, width, height):
    """Return the depth (H, W) in m that Embree measures through the pixel centres, from the pose of `camera_of`."""
    n, e, d = world.scene.spawn_ned
    camera = CameraModel(width, height)
    attitude = quat_from_euler(0.0, 0.0, world.scene.spawn_yaw)
    pose = camera_pose((n, e, d - 3.0), attitude, camera)
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    axes = np.array([rotate(attitude, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))])
    rays = np.stack([np.ones_like(x), x / camera.focal_px, y / camera.focal_px], axis=-1).reshape(-1, 3) @ axes
    start = np.ascontiguousarray(np.broadcast_to(np.array(pose.position_ned, np.float32), rays.shape))
    hits = RayScene.of_instances(world.scene.instances).first_hits(start, rays.astype(np.float32))
    depth = np.where(hits.triangle != NOTHING, hits.distance, np.inf)  # each ray has depth 1, so distances are depths
    return depth.reshape(height, width)


def test_a_depth_picture_has_the_distances_of_a_ray_tracer(world):
    frame = camera_of(world).newest(depth=True)
    assert frame.depth_mm is not None
    truth = traced_m(world, 640, 360)
    near = truth < 65.0
    assert 0.3 < near.mean() < 1.0
    off = np.abs(frame.depth_mm[near] / 1000.0 - truth[near])
    assert np.mean(off < 0.002 + 2e-4 * truth[near]) > 0.995  # others are on an edge: either surface is right
    assert (frame.depth_mm[truth > 66.0] == 0).mean() > 0.995
    np.testing.assert_array_equal(frame.image_rgb, camera_of(world).newest().image_rgb)


def test_depth_pictures_round_trip_through_their_file():
    depths = in_millimetres(np.array([[0.0504, 3.0, 65.535, 65.54, np.inf]], np.float32))
    assert depths.tolist() == [[50, 3000, 65535, 0, 0]]
    np.testing.assert_array_equal(decode_depth(encode_depth(depths)), depths)
    assert decode_depth(b"no picture") is decode_depth(b"") is None


def test_depth_over_http_belongs_to_the_same_frame(world):
    camera = camera_of(world)
    server = FrameServer(("127.0.0.1", 0), camera)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    place = f"http://127.0.0.1:{server.server_port}"
    client = HttpCamera(f"{place}/frame.bmp?width=640", lambda: 1_000_000, depth_url=f"{place}/depth.png")
    try:
        frame = client.newest(1)
        expected = camera.depth_of(frame.frame_id)
        np.testing.assert_array_equal(frame.depth_mm, expected)
        assert client.at(1_000_000).depth_mm is not None
        alone = HttpCamera(f"{place}/depth.png?frame=99999", lambda: 1_000_000)
        with pytest.raises(CameraError, match="99999"):
            alone.newest()
        alone.close()
    finally:
        client.close()
        server.shutdown()
        server.server_close()
        thread.join()


def test_depth_is_rejected_for_the_papers_agent_and_with_optics():
    with pytest.raises(UsageError, match=r"paper .*--depth.*--agent"):
        FlightSpec(pilot="oracle", simulated=Simulated(camera="depth"))
    with pytest.raises(UsageError, match=r"--depth .*--optics"):
        Simulated(camera="depth", optics={"haze": {"density_per_m": 0.02}})
    FlightSpec(pilot="oracle", simulated=Simulated(camera="depth"), agent="mine:agent")
