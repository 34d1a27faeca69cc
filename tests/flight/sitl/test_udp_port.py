"""A UDP port of the simulator receives garbage: its work per exchange is bounded, other senders are not affected."""

import socket
from types import SimpleNamespace

import pytest

from dronecats.flight.sitl.simulation import TruthBus
from dronecats.flight.sitl.sockets import DATAGRAM_BYTES, PEERS, SLICE_BYTES, UdpPort
from foundation.mavlink import Packer, dialect

LOOPBACK = "127.0.0.1"
PACKER = Packer(245, 191)
HEARTBEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def heartbeat():
    return PACKER.pack(HEARTBEAT)


class Sender:
    """A socket that sends to a port."""

    def __init__(self, port):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((LOOPBACK, 0))
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
        self._port = port

    def send(self, data):
        self._socket.sendto(data, (LOOPBACK, self._port.port))

    def received(self):
        try:
            return self._socket.recv(65536)
        except BlockingIOError:
            return b""

    def close(self):
        self._socket.close()


@pytest.fixture
def rig():
    """Return a port with its received and sent data, and a factory of senders. Its clock advances only on request."""
    made = SimpleNamespace(handed=[], to_send=b"", now_s=0.0, cost_s=0.0, garbage=0, senders=[])

    def give(data):
        made.handed.append(data)
        made.now_s += made.cost_s

    def take():
        sent, made.to_send = made.to_send, b""
        return sent

    def garbage():
        made.garbage += 1

    made.port = UdpPort((LOOPBACK, 0), None, take, give, malformed=garbage, now_s=lambda: made.now_s)

    def sender():
        made.senders.append(Sender(made.port))
        return made.senders[-1]

    made.sender = sender
    yield made
    made.port.close()
    for each in made.senders:
        each.close()


@pytest.mark.parametrize("garbage", [bytes(60_000), b"\xfe\x00" * 30_000, bytes(DATAGRAM_BYTES), b"\xfd\xff\x00" * 40])
def test_garbage_is_dropped_and_other_clients_are_served(rig, garbage):
    hostile, client = rig.sender(), rig.sender()
    for _ in range(20):
        hostile.send(garbage)
    frame = heartbeat()
    client.send(frame)
    rig.port.exchange()
    assert b"".join(rig.handed) == frame


def test_an_unfinished_frame_does_not_consume_data_of_other_senders(rig):
    hostile, client = rig.sender(), rig.sender()
    frame = heartbeat()
    hostile.send(b"\xfd\xff\x00\x00\x00\x01\x01\x00\x00\x00")
    client.send(frame)
    rig.port.exchange()
    assert b"".join(rig.handed) == frame


def test_a_frame_may_arrive_in_several_datagrams(rig):
    """A bridge from a serial line may split frames."""
    client, frame = rig.sender(), heartbeat()
    client.send(frame[:7])
    rig.port.exchange()
    assert rig.handed == []
    client.send(frame[7:])
    rig.port.exchange()
    assert b"".join(rig.handed) == frame


def test_a_burst_is_delivered_completely_and_in_order(rig):
    """For example from a client that uploads a file. Within its time limit, one exchange delivers everything."""
    client, frames = rig.sender(), [heartbeat() for _ in range(40)]
    for frame in frames:
        client.send(frame)
    rig.port.exchange()
    assert b"".join(rig.handed) == b"".join(frames)


def test_the_work_of_an_exchange_is_bounded_and_the_rest_follows_later(rig):
    client, frames = rig.sender(), [heartbeat() for _ in range(400)]
    rig.cost_s = 1.0
    for at in range(0, 400, 40):
        client.send(b"".join(frames[at : at + 40]))
    rig.port.exchange(0.5)
    assert 0 < len(b"".join(rig.handed)) <= SLICE_BYTES
    for _ in range(20):
        rig.port.exchange(rig.now_s + 0.5)
    assert b"".join(rig.handed) == b"".join(frames)


def test_heavy_senders_do_not_delay_light_senders(rig):
    busy, client = rig.sender(), rig.sender()
    rig.cost_s = 1.0
    frame = Packer(9, 9).pack(HEARTBEAT)
    for _ in range(60):
        busy.send(b"".join(heartbeat() for _ in range(40)))
    client.send(frame)
    for _ in range(3):
        rig.port.exchange(rig.now_s)
    assert frame in b"".join(rig.handed)
    assert len(rig.handed) == 3


def test_the_backlog_of_one_sender_is_bounded(rig):
    busy = rig.sender()
    rig.cost_s, sent = 1.0, 0
    for _ in range(60):
        for _ in range(20):
            busy.send(b"".join(heartbeat() for _ in range(60)))
            sent += 1
        rig.port.exchange(rig.now_s)
    rig.cost_s = 0.0
    rig.handed.clear()
    rig.port.exchange()
    assert 0 < len(b"".join(rig.handed)) < sent * 60 * len(heartbeat()) / 10


def test_only_senders_of_mavlink_receive_messages(rig):
    hostile, client = rig.sender(), rig.sender()
    hostile.send(b"\x55" * 40)
    client.send(heartbeat())
    rig.port.exchange()
    rig.to_send = heartbeat()
    rig.port.exchange()
    assert hostile.received() == b""
    assert client.received() != b""
    assert rig.garbage == 1
    hostile.send(b"\x55" * 40)
    rig.port.exchange()
    assert rig.garbage == 1  # reported once


def test_the_number_of_peers_is_bounded(rig):
    clients = [rig.sender() for _ in range(PEERS + 4)]
    for client in clients:
        client.send(heartbeat())
        rig.port.exchange()
    rig.to_send = heartbeat()
    rig.port.exchange()
    assert [client.received() != b"" for client in clients] == [False] * 4 + [True] * PEERS


def test_garbage_from_many_addresses_does_not_block_a_client(rig):
    client = rig.sender()
    client.send(heartbeat())
    rig.port.exchange()
    for _ in range(3):
        for _ in range(100):
            hostile = rig.sender()
            hostile.send(b"\xfd\xff\x00")
            rig.port.exchange()
        rig.handed.clear()
        frame = heartbeat()
        client.send(frame)
        rig.port.exchange()
        assert rig.handed == [frame]


def test_garbage_is_not_forwarded_on_the_truth_bus():
    bus = TruthBus()
    here, there = bus.tap(), bus.tap()
    port = UdpPort((LOOPBACK, 0), None, here.take, here.receive, shared=True)
    hostile, listener = Sender(port), Sender(port)
    frame = heartbeat()
    try:
        listener.send(frame)
        port.exchange()
        assert there.take() == frame
        hostile.send(b"\xfe\x00" * 700)
        port.exchange()
        assert there.take() == b""
        assert listener.received() == b""
    finally:
        port.close()
        hostile.close()
        listener.close()
