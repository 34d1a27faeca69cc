"""A wire in vehicle time. It is perfect except during an impairment, whose losses depend on the seed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.mavlink import Packer, Parser, dialect
from hil.impairment import PERFECT, Impairment, OneWay, SteppedWire

TICK_S = 0.01


class Vehicle:
    """Sends a ping with its tick number at every tick, and records the tick at which each ping arrives."""

    def __init__(self, seed: int = 0) -> None:
        self.tick, self._packer, self._parser, self._said = 0, Packer(1, 1), Parser(), b""
        self.received: list[tuple[int, int]] = []  # tick, number
        self.wire = SteppedWire("test://", self._take, self._give, self.pump, lambda: self.tick * TICK_S, seed)

    def pump(self) -> None:
        self.tick += 1
        self._said += self._packer.pack(dialect.MAVLink_ping_message(0, self.tick, 0, 0))
        self.wire.step()

    def _take(self) -> bytes:
        data, self._said = self._said, b""
        return data

    def _give(self, data: bytes) -> None:
        self.received += [(self.tick, m.seq) for m in self._parser.feed(data)]


def talk(vehicle: Vehicle, ticks: int) -> list[tuple[int, int]]:
    """Send a ping with each tick's number, and return the received (tick, number) pairs."""
    packer, parser, received = Packer(245, 191), Parser(), []
    for _ in range(ticks):
        vehicle.wire.send(packer.pack(dialect.MAVLink_ping_message(0, vehicle.tick, 0, 0)))
        vehicle.pump()
        received += [(vehicle.tick, m.seq) for m in parser.feed(vehicle.wire.receive(0.0))]
    return received


def test_an_impairment_delays_both_directions_as_set_and_ends_after_its_duration() -> None:
    vehicle = Vehicle()
    assert talk(vehicle, 50) == [(n, n) for n in range(1, 51)]
    assert vehicle.received == [(n, n) for n in range(50)]
    vehicle.received.clear()
    vehicle.wire.impair(Impairment(delay_s=0.2), Impairment(delay_s=0.07), seconds=1.0)
    received = talk(vehicle, 200)
    delivered = [(tick, number) for tick, number in vehicle.received if tick < 150]
    assert delivered == [(n + 20, n) for n in range(50, 130)]  # pings still in transit after 1 s are lost
    assert [pair for pair in received if pair[0] < 150] == [(n + 7, n) for n in range(51, 143)]
    assert vehicle.received[len(delivered) :] == [(n, n) for n in range(150, 250)]
    assert received[-100:] == [(n, n) for n in range(151, 251)]


def test_the_loss_share_matches_the_setting_and_the_seed_selects_the_lost_pings() -> None:
    received = []
    for seed in (1, 1, 2):
        vehicle = Vehicle(seed)
        talk(vehicle, seed)  # earlier traffic has no effect
        vehicle.received.clear()
        vehicle.wire.impair(Impairment(loss=0.3), PERFECT, seconds=1e9)
        first = vehicle.tick
        assert len(talk(vehicle, 2000)) == 2000
        received.append([number - first for _, number in vehicle.received])
        to, back = vehicle.wire.counts
        assert (to.taken, to.lost, back.lost) == (2000, 2000 - len(received[-1]), 0)
    assert received[0] == received[1] != received[2]
    assert len(received[0]) == pytest.approx(1400, abs=60)


def test_a_receive_timeout_counts_vehicle_time() -> None:
    vehicle = Vehicle()
    vehicle.wire.impair(PERFECT, Impairment(loss=1.0), seconds=5.0)
    assert vehicle.wire.receive(0.5) == b""
    assert vehicle.tick == 50
    assert Parser().feed(vehicle.wire.receive(60.0))[0].seq == vehicle.tick == 500  # the impairment ends at tick 500


@given(st.lists(st.binary(max_size=40)))
def test_an_unimpaired_direction_preserves_all_bytes(parts: list[bytes]) -> None:
    way = OneWay(PERFECT, 0, "up")
    carried = b"".join(unit for i, part in enumerate(parts) for unit in way.carry(i * TICK_S, part))
    data = b"".join(parts)
    assert data.startswith(carried)
    assert len(data) - len(carried) < 300  # an incomplete frame at the end
