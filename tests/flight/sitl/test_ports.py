"""`sitl` and every real-time flight send to the port of a ground station before the station has sent anything."""

import socket
from collections import Counter
from typing import Any

import pytest

from dronecats.flight.sitl import sockets
from dronecats.flight.sitl.config import SimulatorConfig
from dronecats.flight.sitl.simulator_process import Simulator
from foundation.mavlink import Packer, Parser, dialect
from tests.support.ports import free_port


@pytest.fixture
def station(monkeypatch):
    """A ground station's socket on the standard port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind((sockets.LOOPBACK, 0))
        listening.setblocking(False)
        monkeypatch.setattr(sockets, "GCS_PORT", listening.getsockname()[1])
        monkeypatch.setattr(sockets, "GCS_LOCAL", free_port())
        yield listening


@pytest.mark.parametrize(("instance", "count"), [(None, 2), (0, 1)], ids=["a flight of two", "sitl"])
def test_every_vehicle_sends_to_the_station_port_with_its_own_system_id(station, monkeypatch, instance, count):
    for name in ("AGENT_LOCAL", "AGENT_PORT", "TRUTH_LOCAL", "TRUTH_PORT"):
        monkeypatch.setattr(sockets, name, free_port())
    simulator = Simulator(SimulatorConfig(episode="blocks-commanding-01", count=count, speed=50.0, instance=instance))
    try:
        counts, peers = listen(simulator, station, 6.0)
        assert {(system, component) for system, component, _ in counts} == {
            (number, 1) for number in range(1, count + 1)
        }
        for system in peers:
            assert counts[system, 1, "HEARTBEAT"] >= 5
            assert counts[system, 1, "GLOBAL_POSITION_INT"] > 50  # 50 Hz, once the position is known
        request = dialect.MAVLink_param_request_read_message(count, 1, b"MIS_TAKEOFF_ALT", -1)
        station.sendto(Packer(255, 190).pack(request), peers[count])
        answered, _ = listen(simulator, station, 0.1)
        assert [(system, kind) for system, _, kind in answered if kind == "PARAM_VALUE"] == [(count, "PARAM_VALUE")]
    finally:
        simulator.close()


def listen(simulator, station, seconds):
    """Return {(system, component, message): count} of `seconds` of vehicle time, and each system's address."""
    counts: Counter[tuple[int, int, str]] = Counter()
    peers: dict[int, Any] = {}
    parsers: dict[Any, Parser] = {}
    for _ in range(round(seconds * 100)):
        simulator.turn()
        while True:
            try:
                data, peer = station.recvfrom(65536)
            except BlockingIOError:
                break
            for message in parsers.setdefault(peer, Parser()).feed(data):
                counts[message.get_srcSystem(), message.get_srcComponent(), message.get_type()] += 1
                peers[message.get_srcSystem()] = peer
    return counts, peers
