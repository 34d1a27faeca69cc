"""The link detects that a vehicle stops sending all messages, or its important ones."""

import threading
import time

import pytest

from foundation.errors import LinkError
from foundation.mavlink import Packer, dialect
from foundation.setpoints import Velocity
from hil.link.link import Link
from hil.link.transport import Transport, connect
from tests.hil.link import listening
from tests.hil.link.scripted_vehicle import ScriptedVehicle


class Peer(threading.Thread):
    """Sends messages while `beating` is true: always heartbeats, and telemetry while `positions` is true."""

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
            time.sleep(0.02)  # telemetry rate of a vehicle


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


def test_a_silent_vehicle_raises_an_error(flying):
    link, peer = flying
    link.wait(0.2)
    peer.beating = False
    with pytest.raises(LinkError, match="silent"):
        link.wait(60.0)


def test_heartbeats_without_telemetry_raise_an_error(flying):
    link, peer = flying
    link.wait(0.2)
    peer.positions = False
    with pytest.raises(LinkError, match="telemetry"):
        link.wait(60.0)


class Stopping(Transport):
    """An in-memory transport to a vehicle that can be paused while the wall clock continues."""

    def __init__(self):
        self.vehicle = ScriptedVehicle()
        self.wire = self.vehicle.transport()
        self.url = self.wire.url
        self.wall_s, self.stopped_s, self.away_s = 0.0, 0.0, 0.0

    def time_s(self):
        return self.wall_s

    def send(self, data):
        self.wire.send(data)

    def close(self):
        self.wire.close()

    def receive(self, timeout_s):
        passed_s = min(timeout_s, self.stopped_s)
        self.stopped_s -= passed_s
        self.wall_s += (passed_s or 0.02) + self.away_s
        self.away_s = 0.0
        return b"" if passed_s else self.wire.receive(timeout_s)

    def flying_link(self, **options):
        link = Link(self, **options)
        link.connect(10.0)
        link.fly(Velocity(1.2, None), 60.0)
        link.start_offboard()
        link.wait(1.0)
        return link


def test_a_pause_of_the_vehicle_is_reported_with_its_duration():
    wire = Stopping()
    silences: list[float] = []
    link = wire.flying_link()
    link.on_silence = silences.append
    wire.stopped_s = 3.0
    link.wait(2.0)
    assert silences == [pytest.approx(3.0, abs=0.2)]


def test_a_pause_of_our_own_process_is_not_reported_as_silence():
    wire = Stopping()
    silences: list[float] = []
    link = wire.flying_link()
    link.on_silence = silences.append
    wire.away_s = 3.0
    link.wait(2.0)
    assert silences == []


def test_a_pause_of_our_own_process_does_not_lengthen_a_silence_of_the_vehicle():
    wire = Stopping()
    silences: list[float] = []
    link = wire.flying_link(silence_s=5.0)
    link.on_silence = silences.append
    wire.stopped_s, wire.away_s = 3.5, 3.0
    link.wait(2.0)  # raises LinkError if both count
    assert silences == [pytest.approx(3.5, abs=0.2)]


def test_give_up_does_not_wait_for_each_command_after_the_link_is_silent():
    wire = Stopping()
    link = wire.flying_link(silence_s=8.0)
    wire.stopped_s, begun_s = 1e9, wire.wall_s
    with pytest.raises(LinkError, match="silent"):
        link.wait(60.0)
    assert wire.wall_s - begun_s == pytest.approx(8.0, abs=1.0)
    with pytest.raises(LinkError, match="silent"):
        link.give_up("land")
    assert wire.wall_s - begun_s < 12.0


def test_connect_to_an_absent_vehicle_fails_after_the_timeout():
    transport = connect("udpin://127.0.0.1:0")
    link = Link(transport)
    with pytest.raises(LinkError, match="heartbeat"):
        link.connect(1.0)
    link.close()
