"""Compares our MAVLink codec with pymavlink, for every message of the dialect and for invalid streams."""

import math
import struct
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foundation import wire
from foundation.mavlink import Packer, Parser, dialect

CLASSES = [dialect.mavlink_map[number] for number in sorted(dialect.mavlink_map)]
BITS = {"8": 8, "16": 16, "32": 32, "64": 64}


def element(kind: str) -> st.SearchStrategy[Any]:
    """Return a strategy for the values of one element of a field."""
    if kind == "float":
        return st.floats(width=32)
    if kind == "double":
        return st.floats()
    bits = BITS["".join(c for c in kind.split("_t")[0] if c.isdigit())]
    if kind.startswith("uint"):
        return st.one_of(st.just(0), st.integers(0, (1 << bits) - 1))
    return st.one_of(st.just(0), st.integers(-(1 << bits - 1), (1 << bits - 1) - 1))


def message_of(kind: Any) -> st.SearchStrategy[Any]:
    """Return a strategy for the messages of a class. Trailing zeros are frequent: the codec truncates them."""
    fields = []
    for name, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        place = kind.ordered_fieldnames.index(name)
        length = kind.array_lengths[place]
        if type_name == "char":
            fields.append(st.binary(max_size=length or 1) if length else st.binary(min_size=1, max_size=1))
        elif length:
            one = element(type_name)
            fields.append(st.one_of(st.just([0] * length), st.lists(one, min_size=length, max_size=length)))
        else:
            fields.append(element(type_name))
    return st.builds(kind, *fields)


any_message = st.sampled_from(CLASSES).flatmap(message_of)


class Reference:
    """Packs and parses with pymavlink."""

    def __init__(self, system: int = 0, component: int = 0) -> None:
        self.mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.bad = 0

    def pack(self, message: Any) -> bytes:
        data: bytes = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def feed(self, data: bytes) -> list[Any]:
        messages = self.mav.parse_buffer(data) or []
        good = [m for m in messages if m.get_msgId() >= 0]
        self.bad += len(messages) - len(good)
        return good


def same(a: Any, b: Any) -> bool:
    """Return whether two field values are equal and of one type, also inside arrays. NaN equals NaN."""
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    return type(a) is type(b) and (a == b or (a != a and b != b))


def assert_same(ours: Any, theirs: Any) -> None:
    """Assert that every field of pymavlink's message exists and is equal."""
    assert isinstance(ours, type(theirs))
    assert type(ours).__name__ == type(theirs).__name__
    for reader in (
        "get_type", "get_msgId", "get_srcSystem", "get_srcComponent", "get_seq", "get_msgbuf", "get_payload", "get_crc",
        "get_fieldnames", "get_signed", "get_link_id",
    ):  # fmt: skip
        assert same(getattr(ours, reader)(), getattr(theirs, reader)()), reader
    assert vars(ours.get_header()) == vars(theirs.get_header())
    for name, value in vars(theirs).items():
        if name not in ("_header",):
            assert same(getattr(ours, name), value), name
    assert str(ours) == str(theirs)
    assert ours.to_json() == theirs.to_json()


def assert_packed_and_parsed_as_pymavlink_does(message: Any) -> None:
    frame = Packer(7, 191).pack(message)
    assert frame == Reference(7, 191).pack(message), message.msgname
    (ours,), (theirs,) = Parser().feed(frame), Reference().feed(frame)
    assert_same(ours, theirs)
    assert Packer(7, 191).pack(ours) == Reference(7, 191).pack(theirs), "what was parsed can be sent on"


def test_every_message_is_packed_and_parsed_as_in_pymavlink() -> None:
    for kind in CLASSES:
        drawn = given(message_of(kind))(assert_packed_and_parsed_as_pymavlink_does)
        settings(max_examples=5, deadline=None)(drawn)()


def assert_its_fields_alone_are_packed_alike(message: Any) -> None:
    layout = wire.BY_ID[message.get_msgId()]
    fields = tuple(getattr(message, name) for name in message.fieldnames)
    assert Packer(7, 191).frame(layout, layout.payload_of(fields)) == Packer(7, 191).pack(message)
    count = len(fields)
    while count and not np.any(fields[count - 1]) and not np.any(np.signbit(fields[count - 1])):
        count -= 1
    assert layout.payload_of(fields[:count]) == layout.payload(message), "those left out at the end are zero"


def test_packing_from_field_values_equals_packing_a_message() -> None:
    for kind in CLASSES:
        if "char" not in kind.fieldtypes:
            drawn = given(message_of(kind))(assert_its_fields_alone_are_packed_alike)
            settings(max_examples=5, deadline=None)(drawn)()


def test_a_parsed_message_equals_pymavlinks() -> None:
    frame = Packer(1, 1).pack(dialect.MAVLink_statustext_message(4, b"low battery", 0, 0))
    (ours,), (theirs,) = Parser().feed(frame), Reference().feed(frame)
    assert ours == theirs
    assert theirs == ours
    (other,) = Parser().feed(Packer(1, 1).pack(dialect.MAVLink_statustext_message(4, b"low", 0, 0)))
    assert other != theirs


def signed(message: Any) -> bytes:
    mav = dialect.MAVLink(None, srcSystem=3, srcComponent=4)
    mav.signing.secret_key, mav.signing.sign_outgoing = b"k" * 32, True
    return bytes(message.pack(mav))


def version_1(message: Any) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=3, srcComponent=4), force_mavlink1=True))


def unknown_frame(number: int) -> bytes:
    return b"\xfd" + struct.pack("<BBBBBBHB", 3, 0, 0, 1, 1, 1, number & 0xFFFF, number >> 16) + b"abc12"


@st.composite
def damaged(draw: Any) -> bytes:
    """Return a frame with one byte changed, or cut short."""
    frame = bytearray(Packer(1, 1).pack(draw(any_message)))
    place = draw(st.integers(0, len(frame) - 1))
    if draw(st.booleans()):
        return bytes(frame[:place])
    frame[place] ^= draw(st.integers(1, 255))
    return bytes(frame)


small = st.sampled_from([c for c in CLASSES if c.id < 256]).flatmap(message_of)
piece = st.one_of(
    any_message.map(lambda m: Packer(1, 1).pack(m)),
    any_message.map(signed),
    small.map(version_1),
    damaged(),
    st.binary(max_size=40),
    st.sampled_from([b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfd\x00\x02", b"\xfd" * 9, b"\xfe\x00", b""]),
    st.sampled_from([unknown_frame(n) for n in (13, 60_000, 0xFFFFFF)]),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(piece, max_size=8).map(b"".join), st.lists(st.integers(0, 600), max_size=6))
def test_any_stream_in_any_chunks_is_parsed_as_in_pymavlink(stream: bytes, cuts: list[int]) -> None:
    ours, theirs = Parser(), Reference()
    places = [0, *sorted(cut % (len(stream) + 1) for cut in cuts), len(stream)]
    for start, stop in pairwise(places):
        chunk = stream[start:stop]
        messages = ours.feed(chunk)
        try:
            wanted = theirs.feed(chunk)
        except Exception:  # pymavlink fails on these bytes; our parser counts them as bad
            assert ours.bad > 0
            return
        assert [bytes(m.get_msgbuf()) for m in messages] == [bytes(m.get_msgbuf()) for m in wanted]
        for mine, other in zip(messages, wanted, strict=True):
            assert_same(mine, other)
        assert ours.bad == theirs.bad


@settings(max_examples=60, deadline=None)
@given(st.lists(any_message, min_size=1, max_size=5), st.integers(1, 40))
def test_messages_survive_any_chunking(messages: list[Any], size: int) -> None:
    packer, parser = Packer(1, 1), Parser()
    stream = b"".join(packer.pack(m) for m in messages)
    parsed = [m for i in range(0, len(stream), size) for m in parser.feed(stream[i : i + size])]
    assert [m.get_type() for m in parsed] == [m.get_type() for m in messages]
    assert [m.get_seq() for m in parsed] == list(range(len(messages)))
    assert parser.bad == 0


def test_a_damaged_frame_is_counted_and_the_next_one_is_parsed() -> None:
    packer, parser = Packer(1, 1), Parser()
    heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
    broken = bytearray(packer.pack(heartbeat))
    broken[12] ^= 0xFF
    assert [m.get_type() for m in parser.feed(bytes(broken) + packer.pack(heartbeat))] == ["HEARTBEAT"]
    assert parser.bad == 1


def test_the_sequence_number_wraps_after_255() -> None:
    packer, parser = Packer(9, 8), Parser()
    ping = dialect.MAVLink_ping_message(0, 0, 0, 0)
    messages = parser.feed(b"".join(packer.pack(ping) for _ in range(300)))
    assert [m.get_seq() for m in messages] == [n % 256 for n in range(300)]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(9, 8)}


def test_a_value_out_of_range_is_rejected_and_uses_no_sequence_number() -> None:
    packer = Packer(1, 1)
    with pytest.raises(struct.error):
        packer.pack(dialect.MAVLink_heartbeat_message(300, 0, 0, 0, 0, 3))
    (message,) = Parser().feed(packer.pack(dialect.MAVLink_heartbeat_message(2, 0, 0, 0, 0, 3)))
    assert message.get_seq() == 0


class TwoInOne(dialect.MAVLink_param_value_message):  # type: ignore[misc]
    """PARAM_VALUE with the bytes of an integer instead of the float."""

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        payload = struct.pack("<IHH16sB", 2, 1, 0, self._param_id_raw, 6)
        return bytes(self._pack(mav, self.crc_extra, payload))


def test_a_message_class_with_its_own_pack_method_is_packed_by_it() -> None:
    packer = Packer(5, 6)
    first, second = (packer.pack(TwoInOne(b"N", 0.0, 6, 1, 0)) for _ in range(2))
    assert struct.unpack_from("<I", first, 10) == (2,)
    assert first == Reference(5, 6).pack(TwoInOne(b"N", 0.0, 6, 1, 0))
    (parsed,) = Parser().feed(second)
    assert (parsed.get_seq(), parsed.get_srcSystem(), parsed.get_srcComponent()) == (1, 5, 6)


def test_bad_data_is_not_packed() -> None:
    with pytest.raises(TypeError, match="message"):
        Packer(1, 1).pack(dialect.MAVLink_bad_data(b"x", "why"))


def test_nan_and_infinity_are_transmitted_unchanged() -> None:
    message = dialect.MAVLink_attitude_message(1, math.nan, math.inf, -math.inf, 0.0, 0.0, 0.0)
    (parsed,) = Parser().feed(Packer(1, 1).pack(message))
    assert math.isnan(parsed.roll)
    assert (parsed.pitch, parsed.yaw) == (math.inf, -math.inf)


def _heard(system: int, number: int) -> bytes:
    return Packer(system, 1).pack(dialect.MAVLink_ping_message(number, 0, 0, 0))


@given(st.lists(st.tuples(st.integers(1, 3), st.booleans()), max_size=40), st.integers(1, 5))
def test_newest_keeps_the_last_frames_of_each_system(sources, count):
    frames, pings = [], list[tuple[int, int]]()
    heartbeat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for number, (system, ping) in enumerate(sources):
        frames.append(_heard(system, number + 1) if ping else Packer(system, 1).pack(heartbeat))
        pings += [(system, number + 1)] if ping else []
    kept = Parser().feed(wire.newest(b"".join(frames), dialect.MAVLINK_MSG_ID_PING, count))
    wanted = sorted(n for s in (1, 2, 3) for n in [n for who, n in pings if who == s][-count:])
    assert [message.time_usec for message in kept] == wanted


ODD = [b"\x00", b"\xfe\x00", b"\xfd", b"\xfd\x09\x01\x00\x00\x01\x01\x00\x00\x00" + bytes(30)]


@pytest.mark.parametrize("odd", ODD)
def test_newest_keeps_all_data_if_it_contains_anything_but_plain_frames(odd):
    one = _heard(1, 7)
    for data in (odd + one, one + odd, one + one[:-3]):
        assert wire.newest(data, dialect.MAVLINK_MSG_ID_HEARTBEAT, 1) == data


@given(st.lists(st.sampled_from(["ping", "odd", "cut"]), max_size=12))
def test_frames_returns_the_bytes_of_the_messages_that_feed_parses(kinds):
    pieces = {"ping": _heard(1, 7), "odd": b"\xfe\x00\x13", "cut": _heard(2, 9)[:-4]}
    data = b"".join(pieces[kind] for kind in kinds)
    reference, passed = Parser(), Parser()
    for part in (data[: len(data) // 2], data[len(data) // 2 :], _heard(3, 1)):
        assert passed.frames(part) == [bytes(message.get_msgbuf()) for message in reference.feed(part)]
    assert passed.bad == reference.bad
