"""The link reopens its transport after a disconnection."""

import os
import pty
import socket

import pytest

from foundation.errors import LinkError
from hil.link.transport import Reopening, connect


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    """Retry after 0.1 s instead of the usual 0.5 s."""
    monkeypatch.setattr("hil.link.transport.RETRY_S", 0.1)


def test_a_broken_tcp_connection_is_reopened():
    listener = socket.create_server(("127.0.0.1", 0))
    url = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
    wire = Reopening(lambda: connect(url))
    for round_trip in range(3):
        peer, _ = listener.accept()
        peer.sendall(b"hello")
        assert wire.receive(2.0) == b"hello"
        assert wire.reopened == round_trip
        peer.close()
        assert wire.receive(2.0) == b""  # the connection ends without an exception
        wire.send(b"lost")
        assert wire.receive(0.2) == b""  # receive reopens the connection
    wire.close()
    listener.close()


def test_a_serial_device_is_reopened_after_it_is_plugged_in_again(tmp_path):
    device = tmp_path / "ttyACM0"
    line, far = pty.openpty()
    device.symlink_to(os.ttyname(far))
    wire = Reopening(lambda: connect(f"serial://{device}:57600"))
    os.write(line, b"before")
    assert wire.receive(2.0) == b"before"
    device.unlink()
    os.close(far)
    os.close(line)
    assert wire.receive(0.05) == b""
    assert wire.receive(0.2) == b""  # not back yet
    line, far = pty.openpty()
    device.symlink_to(os.ttyname(far))
    assert wire.receive(0.2) == b""
    os.write(line, b"after")
    assert wire.receive(2.0) == b"after"
    assert wire.reopened == 1
    wire.close()


def test_a_connection_that_cannot_be_opened_at_first_raises_an_error():
    with pytest.raises(LinkError, match=r"127\.0\.0\.1:1"):
        Reopening(lambda: connect("tcp://127.0.0.1:1"))
