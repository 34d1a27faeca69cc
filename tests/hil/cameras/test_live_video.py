"""RTSP from a real server with a password. Each image encodes its capture time on the host's clock."""

import subprocess
import threading
import time
from pathlib import Path

import pytest

from foundation.errors import CameraError
from hil.cameras.open import open_camera
from tests.hil.cameras import picture_code
from tests.hil.cameras.host_clock import host_us
from tests.needs import SYSTEM_PYTHON, needs

SERVER = Path(__file__).with_name("rtsp_server.py")
SPAN = 1 << picture_code.BITS  # capture times repeat after this period (1/100 s)

pytestmark = needs("rtsp")


class Server:
    def __init__(self, port: int = 0) -> None:
        self._process = subprocess.Popen(
            [SYSTEM_PYTHON, str(SERVER), "pilot", "hush", str(port)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())

    def url(self, password: str = "hush") -> str:
        return f"rtsp://pilot:{password}@127.0.0.1:{self.port}/live"

    def close(self) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def server():
    started = Server()
    yield started
    started.close()


def since_birth_s(frame) -> float:
    return (int(time.monotonic() * 100) - picture_code.read(frame.image_rgb)) % SPAN / 100


def test_every_read_returns_the_newest_image_even_after_a_pause(server):
    """FFmpeg opens the stream with 1 s of buffered video. The camera must not return it."""
    camera = open_camera(server.url(), host_us)
    assert since_birth_s(camera.newest()) < 0.4
    threading.Event().wait(3.0)
    frame = camera.newest()
    assert since_birth_s(frame) < 0.4  # 40 ms frame period plus coding: 0.05 to 0.08 s on an idle machine
    assert host_us() - frame.time_us < 300_000
    assert abs((camera.following(frame.frame_id).time_us - frame.time_us) / 1e6) < 0.5
    assert (camera.model.width, camera.model.height) == (picture_code.WIDTH, picture_code.HEIGHT)
    camera.close()


def test_a_lost_server_raises_an_error_and_the_stream_reopens_when_it_returns(server):
    camera = open_camera(server.url(), host_us)
    camera.newest()
    port = server.port
    server.close()
    threading.Event().wait(1.5)
    started = time.monotonic()
    with pytest.raises(CameraError, match=r"\d\.\d s") as caught:
        camera.newest()
    assert 4.0 < time.monotonic() - started < 7.0  # the flight waits this long; the vehicle holds
    assert "hush" not in str(caught.value)
    again = Server(port)
    try:
        assert since_birth_s(camera.newest()) < 0.6
        assert camera.reopened == 1
    finally:
        camera.close()
        again.close()


def test_a_wrong_password_is_not_shown_in_the_error(server):
    with pytest.raises(CameraError, match=r"rtsp://\*\*\*@127\.0\.0\.1:\d+/live") as caught:
        open_camera(server.url("guess"), host_us)
    assert "guess" not in str(caught.value)
