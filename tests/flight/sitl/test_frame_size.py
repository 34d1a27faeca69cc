"""Frames of the simulated camera have the size of the model's pictures, or full size on request."""

import threading
import urllib.error
import urllib.request

import cv2
import numpy as np
import pytest

from dronecats.flight.sitl.camera import FrameServer, WorldCamera
from dronecats.flight.sitl.episode_world import origin
from episodes.camera.optics.options import Optics, Sensor
from episodes.records import catalogue
from episodes.world.world import World
from foundation.camera import CameraModel, reduced
from foundation.frames import quat_from_euler
from foundation.mavlink import Packer
from foundation.truth import truth_message
from hil.cameras.http import HttpCamera


@pytest.fixture(scope="module")
def world():
    return World(catalogue.load("blocks-commanding-01"))


def camera_of(world, optics=None):
    """Return a camera of drone 1, 3 m above its start."""
    n, e, d = world.scene.spawn_ned
    zero = (0.0, 0.0, 0.0)
    camera = WorldCamera(world, CameraModel(), lambda data: None, optics=optics)
    message = truth_message(
        1_000_000, (n, e, d - 3.0), zero, quat_from_euler(0.0, 0.0, world.scene.spawn_yaw), zero, zero, origin(world)
    )
    for drone in range(len(world.record.starts)):
        camera.feed(Packer(drone + 1, 51).pack(message))
    return camera


def test_a_frame_matches_the_reduced_full_size_frame(world):
    camera = camera_of(world)
    frame, full = camera.newest().image_rgb, camera.newest(full=True).image_rgb
    assert full.shape == (720, 1280, 3)
    assert frame.shape == (360, 640, 3)
    assert np.abs(frame.astype(float) - reduced(full)).mean() < 1.0
    np.testing.assert_array_equal(camera.at(1_000_000).image_rgb, frame)


def test_sensor_noise_is_added_at_full_size_before_the_reduction(world):
    noisy, clean = camera_of(world, Optics(sensor=Sensor(2000.0, 5.0))), camera_of(world, Optics())

    def noise(full, area):
        a, b = (camera.newest(full=full).image_rgb[area].astype(float) for camera in (noisy, clean))
        return (a - b).std()

    assert noisy.newest().image_rgb.shape == (360, 640, 3)
    assert noise(False, np.s_[10:40, 10:60]) < 0.7 * noise(True, np.s_[20:80, 20:120])


def test_a_client_chooses_the_width_of_its_frames(world):
    server = FrameServer(("127.0.0.1", 0), camera_of(world))
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    url = f"http://127.0.0.1:{server.server_port}/frame.bmp"

    def shape(query):
        data = urllib.request.urlopen(url + query, timeout=60.0).read()
        return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)).shape

    try:
        assert shape("") == shape("?width=1280&drone=1") == (720, 1280, 3)
        assert shape("?width=640") == shape("?width=640&at=1000000") == (360, 640, 3)
        with pytest.raises(urllib.error.HTTPError) as refusal:
            shape("?width=500")
        assert "500" in refusal.value.read().decode()
        agents = HttpCamera(f"{url}?width=640", lambda: 1_000_000)
        assert agents.newest(1).image_rgb.shape == agents.at(1_000_000).image_rgb.shape == (360, 640, 3)
        agents.close()
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
