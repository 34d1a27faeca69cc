"""No bytes that arrive on a link stop the autopilot."""

import random
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from autopilot.autopilot import HANDLERS
from foundation.mavlink import Packer, dialect
from tests.autopilot.commander_bench import Bench

FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
CLASSES = {name: getattr(dialect, f"MAVLink_{name.lower()}_message") for name in HANDLERS}


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench(profile="minimal")


@pytest.fixture(scope="module")
def armable() -> Bench:
    """A bench without the traffic of the other tests, after which the vehicle may refuse to arm."""
    return Bench(profile="minimal")


def alive(bench: Bench) -> None:
    """Assert that the autopilot still ticks and answers."""
    bench.run(0.1)
    bench.client.send(dialect.MAVLink_ping_message(1, 2, 0, 0))
    assert bench.client.of("PING")
    bench.client.inbox.clear()


def with_payload(kind: str, payload: bytes) -> bytes:
    """Return a valid frame of a message type with an arbitrary payload."""
    cls = CLASSES[kind]
    size = cls.unpacker.size
    message = object.__new__(cls)
    dialect.MAVLink_message.__init__(message, cls.id, kind)
    mav = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
    return bytes(message._pack(mav, cls.crc_extra, payload[:size].ljust(size, b"\0")))


@FUZZ
@given(data=st.binary(max_size=600))
def test_the_autopilot_survives_random_bytes(bench: Bench, data: bytes) -> None:
    bench.client.port.receive(data)
    bench.client.port.receive(b"\0" * 300)  # completes any frame that the bytes began
    alive(bench)


@pytest.mark.parametrize("kind", sorted(set(HANDLERS) - {"SETUP_SIGNING"}))  # locks the port: see test_signing
def test_the_autopilot_survives_every_message_with_any_payload(bench: Bench, kind: str) -> None:
    generator = random.Random(kind)
    size = CLASSES[kind].unpacker.size
    special = [struct.pack("<f", x) for x in (float("nan"), float("inf"), -float("inf"), 3.4e38, -0.0)]
    for _ in range(60):
        payload = bytearray(generator.randbytes(size))
        for _ in range(generator.randrange(4)):
            at = 4 * generator.randrange(max(1, size // 4))
            payload[at : at + 4] = generator.choice(special)
        if generator.random() < 0.5:  # addressed to us
            names = CLASSES[kind].ordered_fieldnames
            offset = 0
            for name, width in zip(names, _widths(kind), strict=True):
                if name in ("target_system", "target_component", "target"):
                    payload[offset] = 1
                offset += width
        bench.client.port.receive(with_payload(kind, bytes(payload)))
    alive(bench)
    bench.commander.disarm(force=True)
    assert bench.autopilot.node.handler_errors == 0  # no handler raised an error, not even one that the node caught


def _widths(kind: str) -> list[int]:
    cls = CLASSES[kind]
    codes = {"uint8_t": 1, "int8_t": 1, "char": 1, "uint16_t": 2, "int16_t": 2, "uint64_t": 8, "int64_t": 8}
    types = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    arrays = dict(
        zip(cls.fieldnames, [cls.lengths[cls.ordered_fieldnames.index(n)] for n in cls.fieldnames], strict=True)
    )
    return [codes.get(types[name], 4) * max(1, arrays[name]) for name in cls.ordered_fieldnames]


ARM = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


@settings(FUZZ, derandomize=True)  # a random change keeps the checksum once in 65,536 times
@given(
    flips=st.lists(st.tuples(st.integers(0, 60), st.integers(1, 255)), min_size=1, max_size=4), cut=st.integers(0, 20)
)
def test_a_damaged_command_to_arm_has_no_effect(armable: Bench, flips: list[tuple[int, int]], cut: int) -> None:
    whole = Packer(245, 190).pack(ARM)
    frame = bytearray(whole)
    for at, value in flips:
        frame[at % len(frame)] ^= value
    damaged = bytes(frame[: len(frame) - cut])
    armable.client.port.receive(damaged)
    armable.client.port.receive(b"\0" * 300)
    alive(armable)
    assert armable.commander.armed == (damaged == whole)
    armable.commander.disarm(force=True)
    armable.client.port.receive(whole)  # the undamaged command arms
    assert armable.commander.armed
    armable.commander.disarm(force=True)


def test_garbage_is_counted_and_reported_once(bench: Bench) -> None:
    fresh = Bench(profile="minimal")
    fresh.client.forget()
    for _ in range(5):
        fresh.client.port.receive(b"\x55" * 40)
        fresh.client.port.receive(b"\xfd\x09\x00\x00\x00\x01\x01\xff\xff\xff" + b"\x11" * 20)
    assert fresh.client.port.parser.bad > 0
    assert len([t for t in fresh.client.texts() if "Malformed" in t]) == 1


def test_an_echo_of_the_vehicle_is_ignored() -> None:
    bench = Bench(profile="minimal")
    bench.client.port.receive(Packer(1, 1).pack(ARM))
    assert not bench.commander.armed
