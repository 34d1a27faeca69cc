"""MAVLink 2 signing: with a key, the vehicle accepts only messages signed with it, and none of them twice."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation.mavlink import dialect
from tests.autopilot.commander_bench import TICK_US, Bench, Client

KEY = bytes(range(1, 33))
NOW = 3_000_000_000_000  # 10 µs since 2015


class SigningClient:
    """A client that uses the signing of pymavlink."""

    def __init__(self, bench: Bench, key: bytes = KEY, time: int = NOW + 100, link: int = 3) -> None:
        self.port = bench.client.port
        self.mav = dialect.MAVLink(None, srcSystem=245, srcComponent=190)
        self.mav.robust_parsing = True
        self.mav.signing.secret_key = key
        self.mav.signing.timestamp = time
        self.mav.signing.link_id = link
        self.mav.signing.sign_outgoing = True

    def packed(self, message: Any) -> bytes:
        return bytes(message.pack(self.mav))

    def send(self, message: Any) -> None:
        self.port.receive(self.packed(message))

    def received(self) -> list[Any]:
        return self.mav.parse_buffer(self.port.take()) or []


def ping(number: int) -> Any:
    return dialect.MAVLink_ping_message(1, number, 0, 0)


def answered(bench: Bench) -> list[int]:
    """Return the numbers of the answered pings, with or without a valid signature."""
    frames = dialect.MAVLink(None)
    frames.robust_parsing = True
    messages = frames.parse_buffer(bench.client.port.take()) or []
    return [m.seq for m in messages if m.get_type() == "PING" and m.target_system]


def keyed(key: bytes = KEY) -> Bench:
    bench = Bench(profile="minimal")
    bench.client.forget()
    bench.client.send(dialect.MAVLink_setup_signing_message(1, 1, list(key), NOW))
    return bench


def test_without_a_key_every_message_is_accepted() -> None:
    bench = Bench(profile="minimal")
    bench.client.forget()
    bench.client.send(ping(1))
    SigningClient(bench).send(ping(2))
    assert answered(bench) == [1, 2]
    assert bench.client.port.signing.rejected == 0


def test_with_a_key_only_messages_signed_with_it_are_accepted() -> None:
    bench = keyed()
    bench.client.send(ping(1))
    SigningClient(bench, key=b"x" * 32).send(ping(2))
    SigningClient(bench).send(ping(3))
    assert answered(bench) == [3]
    assert bench.client.port.signing.rejected == 2


def test_the_signatures_of_the_vehicle_are_valid() -> None:
    bench = keyed()
    client = SigningClient(bench)
    client.send(ping(1))
    bench.run(5.0)
    messages = client.received()
    assert {m.get_type() for m in messages} >= {"PING", "HEARTBEAT"}
    assert all(m.get_signed() for m in messages)
    assert client.mav.signing.badsig_count == 0
    times = [int.from_bytes(bytes(m.get_msgbuf())[-12:-6], "little") for m in messages]
    assert times == sorted(set(times))
    assert times[-1] - times[0] == pytest.approx(5e5, rel=0.3)  # follows the vehicle's clock


def test_a_replayed_message_is_rejected() -> None:
    bench = keyed()
    client = SigningClient(bench)
    arm = client.packed(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    client.port.receive(arm)
    assert bench.commander.armed
    bench.commander.disarm(force=True)
    client.port.receive(arm)
    assert not bench.commander.armed


def test_a_new_link_with_an_old_timestamp_is_rejected() -> None:
    bench = keyed()
    SigningClient(bench, time=NOW - 7_000_000, link=9).send(ping(1))
    SigningClient(bench, time=NOW - 5_000_000, link=8).send(ping(2))
    assert answered(bench) == [2]


def test_a_forged_timestamp_does_not_block_the_real_client() -> None:
    bench = keyed()
    forged = bytearray(SigningClient(bench, time=NOW * 10).packed(ping(1)))
    forged[-1] ^= 1
    bench.client.port.receive(bytes(forged))
    SigningClient(bench).send(ping(2))
    assert answered(bench) == [2]


def test_radio_status_is_accepted_unsigned() -> None:
    bench = keyed()
    bench.client.send(dialect.MAVLink_radio_status_message(1, 1, 1, 1, 1, 0, 0))
    assert bench.client.port.signing.rejected == 0


def test_a_key_applies_to_every_port() -> None:
    bench = Bench(profile="minimal")
    other = Client(bench.autopilot.open_port("minimal"), 255, 190)
    bench.client.send(dialect.MAVLink_setup_signing_message(1, 1, list(KEY), NOW))
    other.send(ping(4))
    assert [m.seq for m in other.of("PING") if m.target_system] == []


def test_an_armed_vehicle_rejects_a_key() -> None:
    bench = Bench(profile="minimal")
    bench.client.send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert bench.commander.armed
    bench.client.send(dialect.MAVLink_setup_signing_message(1, 1, list(KEY), NOW))
    assert not bench.client.port.signing.active


def test_only_signed_messages_change_or_remove_the_key() -> None:
    bench = keyed()
    bench.client.send(dialect.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    bench.client.send(dialect.MAVLink_setup_signing_message(1, 1, [9] * 32, NOW))
    assert bench.client.port.signing.active
    client = SigningClient(bench)
    client.send(dialect.MAVLink_setup_signing_message(1, 1, [7] * 32, NOW + 500))
    client.send(ping(1))  # still with the old key
    SigningClient(bench, key=bytes([7] * 32), time=NOW + 600).send(ping(2))
    assert answered(bench) == [2]
    SigningClient(bench, key=bytes([7] * 32), time=NOW + 700).send(
        dialect.MAVLink_setup_signing_message(1, 1, [0] * 32, 0)
    )
    bench.client.send(ping(3))
    assert answered(bench) == [3]


def test_keys_for_broadcast_or_other_systems_are_ignored() -> None:
    bench = Bench(profile="minimal")
    for target in (0, 2):
        bench.client.send(dialect.MAVLink_setup_signing_message(target, 1, list(KEY), NOW))
    assert not bench.client.port.signing.active


def test_rejected_signatures_are_reported_once() -> None:
    bench = keyed()
    listener = Client(bench.autopilot.open_port("minimal"), 255, 190)
    for number in range(5):
        bench.client.send(ping(number))
    bench.run(5 * TICK_US * 1e-6)
    assert len([text for text in listener.texts() if "signature" in text]) == 1


@pytest.fixture(scope="module")
def bench() -> Bench:
    return keyed()


@given(flips=st.lists(st.tuples(st.integers(0, 60), st.integers(1, 255)), min_size=1, max_size=4))
@settings(deadline=None, max_examples=80)
def test_no_damaged_frame_is_accepted(bench: Bench, flips: list[tuple[int, int]]) -> None:
    bench.client.port.signing.set_up(KEY, NOW, bench.time_us)
    whole = SigningClient(bench).packed(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    frame = bytearray(whole)
    for at, value in flips:
        frame[at % len(frame)] ^= value
    bench.client.port.receive(bytes(frame) + bytes(300))
    assert bytes(frame) == whole or not bench.commander.armed
    bench.commander.disarm(force=True)
