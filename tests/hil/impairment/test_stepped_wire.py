"""A wire in vehicle time: perfect until it is impaired, then late and lossy by the seed, and perfect again."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foundation.mavlink import Packer, Parser, dialect
from hil.impairment import PERFECT, Impairment, OneWay, SteppedWire

TICK_S = 0.01


class Vehicle:
    """Says its tick at every tick, as a ping, and notes when it hears which."""

    def __init__(self, seed: int = 0) -> None:
        self.tick, self._packer, self._parser, self._said = 0, Packer(1, 1), Parser(), b""
        self.heard: list[tuple[int, int]] = []  # tick, number
        self.wire = SteppedWire("test://", self._take, self._give, self.pump, lambda: self.tick * TICK_S, seed)

    def pump(self) -> None:
        self.tick += 1
        self._said += self._packer.pack(dialect.MAVLink_ping_message(0, self.tick, 0, 0))
        self.wire.step()

    def _take(self) -> bytes:
        said, self._said = self._said, b""
        return said

    def _give(self, data: bytes) -> None:
        self.heard += [(self.tick, m.seq) for m in self._parser.feed(data)]


def talk(vehicle: Vehicle, ticks: int) -> list[tuple[int, int]]:
    """Send a ping of the number of each tick, and return (tick, number) of all that is heard on so many."""
    packer, parser, heard = Packer(245, 191), Parser(), []
    for _ in range(ticks):
        vehicle.wire.send(packer.pack(dialect.MAVLink_ping_message(0, vehicle.tick, 0, 0)))
        vehicle.pump()
        heard += [(vehicle.tick, m.seq) for m in parser.feed(vehicle.wire.receive(0.0))]
    return heard


def test_it_is_perfect_then_late_by_as_much_as_was_asked_for_and_then_perfect() -> None:
    vehicle = Vehicle()
    assert talk(vehicle, 50) == [(n, n) for n in range(1, 51)]
    assert vehicle.heard == [(n, n) for n in range(50)]
    vehicle.heard.clear()
    vehicle.wire.impair(Impairment(delay_s=0.2), Impairment(delay_s=0.07), seconds=1.0)
    heard = talk(vehicle, 200)
    told = [(tick, number) for tick, number in vehicle.heard if tick < 150]
    assert told == [(n + 20, n) for n in range(50, 130)]  # what had not arrived after the second is lost
    assert [pair for pair in heard if pair[0] < 150] == [(n + 7, n) for n in range(51, 143)]
    assert vehicle.heard[len(told) :] == [(n, n) for n in range(150, 250)]
    assert heard[-100:] == [(n, n) for n in range(151, 251)]


def test_the_share_that_was_asked_for_is_lost_and_which_is_the_seeds() -> None:
    heard = []
    for seed in (1, 1, 2):
        vehicle = Vehicle(seed)
        talk(vehicle, seed)  # what came before it was impaired has no say
        vehicle.heard.clear()
        vehicle.wire.impair(Impairment(loss=0.3), PERFECT, seconds=1e9)
        first = vehicle.tick
        assert len(talk(vehicle, 2000)) == 2000
        heard.append([number - first for _, number in vehicle.heard])
        to, back = vehicle.wire.counts
        assert (to.taken, to.lost, back.lost) == (2000, 2000 - len(heard[-1]), 0)
    assert heard[0] == heard[1] != heard[2]
    assert len(heard[0]) == pytest.approx(1400, abs=60)


def test_a_silent_wire_gives_up_in_vehicle_time() -> None:
    vehicle = Vehicle()
    vehicle.wire.impair(PERFECT, Impairment(loss=1.0), seconds=5.0)
    assert vehicle.wire.receive(0.5) == b""
    assert vehicle.tick == 50
    assert Parser().feed(vehicle.wire.receive(60.0))[0].seq == vehicle.tick == 500  # when it is perfect again


@given(st.lists(st.binary(max_size=40)))
def test_a_perfect_way_neither_loses_nor_changes_bytes(parts: list[bytes]) -> None:
    way = OneWay(PERFECT, 0, "up")
    carried = b"".join(unit for i, part in enumerate(parts) for unit in way.carry(i * TICK_S, part))
    data = b"".join(parts)
    assert data.startswith(carried)
    assert len(data) - len(carried) < 300  # the beginning of a frame whose end has not come
