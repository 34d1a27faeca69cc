"""The link measures its waits with a clock, independently of the number of reads."""

import pytest

from foundation.errors import LinkError
from foundation.mavlink import Packer, dialect
from hil.link.link import Link
from hil.link.transport import MemoryTransport, Transport
from tests.hil.link.scripted_vehicle import ScriptedVehicle


class SerialLine(Transport):
    """A 57,600 baud line with a camera and no autopilot. It delivers 3 bytes every 3 ms of its clock."""

    url, PIECE_S = "serial:///dev/test:57600", 0.003

    def __init__(self):
        self.now_s = 100.0
        camera = Packer(1, 100)
        self.packet = camera.pack(dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3))
        self.at = 0

    def time_s(self):
        return self.now_s

    def receive(self, timeout_s):
        self.now_s += self.PIECE_S
        self.at = (self.at + 3) % len(self.packet)
        return self.packet[self.at : self.at + 3]

    def send(self, data):
        pass

    def close(self):
        pass


@pytest.mark.parametrize("patience_s", [1.0, 30.0])
def test_small_pieces_do_not_shorten_the_wait_for_a_heartbeat(patience_s):
    line = SerialLine()
    began_s = line.now_s
    link = Link(line)
    with pytest.raises(LinkError, match=f"within {patience_s:g} s"):
        link.connect(patience_s)
    assert line.now_s - began_s == pytest.approx(patience_s, abs=0.1)


class BootsAnew(ScriptedVehicle):
    """Sends no position for 2 s, then reboots and sends positions."""

    def __init__(self):
        super().__init__()
        self.time_ms, self.now_s = 60_000, 0.0
        self.silent = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED}

    def transport(self):
        return MemoryTransport("memory://", self.take, self.give, self.step, lambda: self.now_s)

    def step(self):
        self.now_s += 0.02
        if self.silent and self.now_s > 2.0:
            self.silent, self.time_ms = set(), 1000
        super().step()


def test_connect_succeeds_if_the_vehicle_reboots_during_the_wait():
    link = Link(BootsAnew().transport())
    link.connect(30.0)
    assert link.state.position_ned == (0.0, 0.0, -2.5)
