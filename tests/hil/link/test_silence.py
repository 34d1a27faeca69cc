"""A vehicle that goes quiet, wholly or in what matters, is noticed."""

import threading
import time

import pytest

from foundation.errors import LinkError
from foundation.mavlink import Packer, dialect
from hil.link.link import Link
from hil.link.transport import connect
from tests.hil.link import listening


class Peer(threading.Thread):
    """Sends heartbeats, and positions until told to stop."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self.transport = connect(url)
        self.packer = Packer(1, 1)
        self.beating, self.positions = True, True

    def run(self):
        milliseconds = 0
        while self.beating:
            milliseconds += 20
            messages = [dialect.MAVLink_heartbeat_message(2, 12, 129, 393216, 4, 3)]
            if self.positions:
                messages.append(dialect.MAVLink_local_position_ned_message(milliseconds, 0, 0, -2, 0, 0, 0))
                messages.append(dialect.MAVLink_attitude_message(milliseconds, 0, 0, 0, 0, 0, 0))
            for message in messages:
                self.transport.send(self.packer.pack(message))
            time.sleep(0.02)  # the pace of a vehicle


@pytest.fixture
def flying():
    transport = listening.udp()
    peer = Peer(f"udpout://127.0.0.1:{transport.port}")
    peer.start()
    link = Link(transport, silence_s=0.6)
    link.connect(10.0)
    yield link, peer
    peer.beating = False
    peer.join()
    link.close()


def test_silence_is_noticed(flying):
    link, peer = flying
    link.wait(0.2)
    peer.beating = False
    with pytest.raises(LinkError, match="silent"):
        link.wait(60.0)


def test_heartbeats_without_telemetry_are_noticed(flying):
    link, peer = flying
    link.wait(0.2)
    peer.positions = False
    with pytest.raises(LinkError, match="telemetry"):
        link.wait(60.0)


def test_nobody_there_is_said_after_the_patience():
    transport = connect("udpin://127.0.0.1:0")
    link = Link(transport)
    with pytest.raises(LinkError, match="heartbeat"):
        link.connect(1.0)
    link.close()
