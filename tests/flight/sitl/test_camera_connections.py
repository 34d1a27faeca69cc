"""Camera connections that never send a request do not delay pictures for others."""

import http.client
import socket
import struct
import threading
import time
from typing import Any

import numpy as np
import pytest

from dronecats.flight.sitl import camera as camera_process
from foundation.camera import CameraModel, Frame
from foundation.errors import UsageError

HALF = b"GET /frame.bmp HTTP/1.1\r\nHost: 127"


class Camera:
    """Returns one black picture once `is_ready` is set."""

    camera = CameraModel()

    def __init__(self) -> None:
        self.is_ready = threading.Event()
        self.is_ready.set()
        self.is_asked = threading.Event()

    def newest(self, drone: int, *, full: bool, depth: bool) -> Frame:
        self.is_asked.set()
        assert self.is_ready.wait(10.0)
        return Frame(drone=0, image_rgb=np.zeros((4, 4, 3), np.uint8), frame_id=1, time_us=2)


@pytest.fixture
def camera() -> Any:
    return Camera()


@pytest.fixture
def server(camera, monkeypatch):
    monkeypatch.setattr(camera_process, "CONNECTIONS", 8)
    made = camera_process.FrameServer(("127.0.0.1", 0), camera)
    thread = threading.Thread(target=made.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield made
    made.shutdown()
    made.server_close()
    thread.join()


def status(connection):
    connection.request("GET", "/frame.bmp")
    answer = connection.getresponse()
    answer.read()
    return answer.status


def test_the_agent_is_served_while_other_connections_stall(server):
    threads = threading.active_count()  # includes connections of earlier tests
    before = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10.0)
    assert status(before) == 200
    stalled = [socket.create_connection(server.server_address, timeout=10.0) for _ in range(60)]
    for each in stalled:
        each.sendall(HALF)
    after = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10.0)
    assert status(after) == 200
    own = id(before.sock)
    assert status(before) == 200
    assert id(before.sock) == own  # other connections did not close it
    due_s = time.monotonic() + 10.0
    while threading.active_count() > threads + 15:
        assert time.monotonic() < due_s, "each of them keeps a thread"
        time.sleep(0.01)
    for each in stalled:
        each.close()
    before.close()
    after.close()


def test_connections_without_a_timely_request_are_closed(server, monkeypatch):
    monkeypatch.setattr(server.RequestHandlerClass, "timeout", 0.2)
    with socket.create_connection(server.server_address, timeout=10.0) as stalled:
        stalled.sendall(HALF)
        assert stalled.recv(1) == b""


def test_a_client_that_leaves_before_its_picture_is_not_an_error(server, camera, capsys):
    camera.is_ready.clear()
    threads = threading.active_count()
    with socket.create_connection(server.server_address, timeout=10.0) as leaving:
        leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closes with a reset
        leaving.sendall(HALF + b".0.0.1\r\n\r\n")
        assert camera.is_asked.wait(10.0)
    camera.is_ready.set()
    while threading.active_count() > threads:
        time.sleep(0.001)
    assert capsys.readouterr().err == ""


def test_a_port_in_use_is_rejected_unless_the_next_free_port_is_allowed(camera):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(UsageError, match=f"TCP port {port} is in use"):
            camera_process.serve(camera, port)
        with camera_process.serve(camera, port, or_next_free=True) as served:
            assert port < served.server_port < port + camera_process.NEXT_PORTS
        assert served.server_address[0] == "127.0.0.1"
