"""Fast codec of MAVLink 2 frames, with tables from pymavlink's message classes.

The codec is several times as fast as pymavlink and gives the same bytes and fields, as tests check. It finds frames of
any kind, but decodes only plain frames: MAVLink 2 without a signature. `foundation.mavlink.Parser` passes other intact
frames to pymavlink. Frame layout: mavlink.io/en/guide/serialization.html.
"""

import math
import re
import struct
from operator import attrgetter, itemgetter
from typing import Any

from pymavlink.dialects.v20 import development as dialect

MARKER, MARKER_V1 = 0xFD, 0xFE
HEADER_BYTES, HEADER_BYTES_V1, CHECKSUM_BYTES = 10, 6, 2
SIGNATURE_BYTES = 13
SIGNED = 0x01  # bit in the incompatibility flags

_LOG_TIME = struct.Struct(">Q")  # time (µs) before each frame of a tlog, the log format of ground stations
_SANE_US = 1 << 56  # µs, two thousand years; a larger value is not a time
_SHORTEST_LOGGED = _LOG_TIME.size + HEADER_BYTES_V1 + CHECKSUM_BYTES
_LENGTH_KNOWN = 3  # number of first bytes that determine a frame's length
_MARKERS = re.compile(rb"[\xfd\xfe]")
Fields = tuple[Any, ...]  # field values of a message, in the dialect's order; omitted values at the end are zero
_HEADER = struct.Struct("<BBBBBBHB")  # length, both flags, sequence, system, component, message id (16 + 8 bits)
checksum = dialect.mcrf4xx or (lambda data: dialect.x25crc(data).crc)  # CRC-16/MCRF4XX


class _OnDemand:
    """An attribute that is computed from the frame when it is first read."""

    def __init__(self, name: str, make: Any) -> None:
        self._name, self._make = name, make

    def __get__(self, message: Any, owner: Any = None) -> Any:
        value = message.__dict__[self._name] = self._make(message._frame)
        return value


def _header(frame: bytes) -> Any:
    length, incompatible, compatible, sequence, system, component, low, high = _HEADER.unpack_from(frame, 1)
    return dialect.MAVLink_header(low | high << 16, incompatible, compatible, length, sequence, system, component)


def _decoded_class(base: Any) -> Any:
    """Return a subclass of `base` for messages decoded here; they behave as if pymavlink had parsed them."""
    members = {
        "__doc__": base.__doc__,
        "__module__": base.__module__,
        "__slots__": (),
        "_type": base.msgname,
        "_fieldnames": base.fieldnames,
        "_signed": False,
        "_link_id": None,
        "_instances": None,
        "_instance_field": base.instance_field,
        "_instance_offset": base.instance_offset,
        "_header": _OnDemand("_header", _header),
        "_msgbuf": _OnDemand("_msgbuf", bytearray),
        # pymavlink's `_payload` begins at byte 6, not at the end of the header
        "_payload": _OnDemand("_payload", lambda frame: bytearray(frame[6:-CHECKSUM_BYTES])),
        "_crc": _OnDemand("_crc", lambda frame: frame[-2] | frame[-1] << 8),
        "get_msgId": lambda message, number=base.id: number,
        "get_srcSystem": lambda message: message._frame[5],
        "get_srcComponent": lambda message: message._frame[6],
        "get_seq": lambda message: message._frame[4],
    }
    return type(base.__name__, (base,), members)


class MessageLayout:
    """Wire layout of one kind of message. `extra` (CRC_EXTRA, one byte) is part of the checksum."""

    def __init__(self, base: Any) -> None:
        self.extra = bytes([base.crc_extra])
        self.name = str(base.msgname)
        self._struct = base.unpacker
        self._class = _decoded_class(base)
        wire = list(base.ordered_fieldnames)
        kinds = dict(zip(base.fieldnames, base.fieldtypes, strict=True))
        self._names = wire
        self._texts = [name for name in wire if kinds[name] == "char"]
        self._arrays = [(place, count) for place, count in enumerate(base.lengths) if count > 1]
        self._arrays_reversed = self._arrays[::-1]
        read = attrgetter(*(f"_{name}_raw" if kinds[name] == "char" else name for name in wire))
        self._read = read if len(wire) > 1 else lambda message: (read(message),)
        declared = list(base.fieldnames)
        self._in_wire_order = itemgetter(*map(declared.index, wire)) if len(wire) > 1 else tuple
        zeros = {name: [0] * count if count > 1 else 0 for name, count in zip(wire, base.lengths, strict=True)}
        self._zeros = tuple(zeros[name] for name in declared)
        self._id = (base.id & 0xFFFF, base.id >> 16)

    def payload(self, message: Any) -> bytes:
        """Return the payload without its trailing zeros. Raises struct.error for a value that does not fit."""
        return self._packed(self._read(message))

    def payload_of(self, fields: Fields) -> bytes:
        """Return the payload of a message with these fields, without trailing zeros. Text fields are given as bytes.

        This is three times as fast as making a message object and calling `payload`. Raises struct.error.
        """
        return self._packed(self._in_wire_order(fields + self._zeros[len(fields) :]))

    def _packed(self, values: Any) -> bytes:
        if self._arrays:
            values = list(values)
            for place, count in self._arrays_reversed:
                values[place : place + 1] = values[place][:count]
        data: bytes = self._struct.pack(*values)
        return data.rstrip(b"\0") or data[:1]

    def frame(self, message: Any, sequence: int, system: int, component: int) -> bytes:
        """Return the message as an unsigned MAVLink 2 frame. Raises struct.error."""
        return self.framed(self.payload(message), sequence, system, component)

    def framed(self, payload: bytes, sequence: int, system: int, component: int) -> bytes:
        """Return a payload as an unsigned MAVLink 2 frame."""
        checked = _HEADER.pack(len(payload), 0, 0, sequence, system, component, *self._id) + payload
        check: bytes = checksum(checked + self.extra).to_bytes(2, "little")
        return b"\xfd" + checked + check

    def message(self, frame: bytes) -> Any:
        """Return the message in an intact frame; trimmed or missing fields are zero."""
        layout = self._struct
        values: Any
        if frame[1] >= layout.size:
            values = layout.unpack_from(frame, HEADER_BYTES)
        else:
            values = layout.unpack(frame[HEADER_BYTES:-CHECKSUM_BYTES].ljust(layout.size, b"\0"))
        if self._arrays:
            values = list(values)
            for place, count in self._arrays:
                values[place : place + count] = [values[place : place + count]]
        fields = dict(zip(self._names, values, strict=True))
        for name in self._texts:
            raw = fields[f"_{name}_raw"] = fields[name].rstrip(b"\0")
            fields[name] = raw.split(b"\0", 1)[0].decode("ascii", errors="replace")
        fields["_frame"] = frame
        message = object.__new__(self._class)
        message.__dict__ = fields
        return message


class OwnPacking(MessageLayout):
    """Layout of a message class that overrides `pack`, such as PARAM_VALUE with an integer in its float field."""

    def frame(self, message: Any, sequence: int, system: int, component: int) -> bytes:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        mav.seq = sequence
        return bytes(message.pack(mav))


class LayoutsById(dict[int, MessageLayout]):
    """Message id → layout, created on demand. KeyError for an id that is not in the dialect."""

    def __missing__(self, message_id: int) -> MessageLayout:
        layout = self[message_id] = MessageLayout(dialect.mavlink_map[message_id])
        return layout


class LayoutsByClass(dict[Any, MessageLayout]):
    """Message class → layout, created on demand. TypeError for a class that is not in the dialect."""

    def __missing__(self, kind: Any) -> MessageLayout:
        base = dialect.mavlink_map.get(getattr(kind, "id", None))
        if base is None or not issubclass(kind, base):
            raise TypeError(f"{kind.__name__} is not a message of the dialect {dialect.DIALECT}")
        layout = self[kind] = BY_ID[base.id] if kind.pack is base.pack else OwnPacking(base)
        return layout


BY_ID = LayoutsById()
BY_CLASS = LayoutsByClass()


def clamped(value: float, low: int, high: int, unknown: int = 0) -> int:
    """Return the value rounded and clamped into an integer field; `unknown` when it is not finite."""
    if not math.isfinite(value):
        return unknown
    return min(max(round(value), low), high)


def int16(value: float) -> int:
    """Return the value rounded and clamped into an int16 field."""
    return clamped(value, -32768, 32767)


def int32(value: float) -> int:
    """Return the value rounded and clamped into an int32 field."""
    return clamped(value, -(1 << 31), (1 << 31) - 1)


def scan(data: bytes) -> tuple[list[bytes], int, int]:
    """Cut bytes into frames; return (intact frames, offset of an incomplete last frame, count of garbage).

    Without an incomplete frame, the offset is the length of the data.
    Garbage is skipped and counted as in pymavlink. A stretch without a marker, a damaged frame, and a frame of an
    unknown message count 1 each. Frames are MAVLink 1 or 2, signed or not; signatures are not verified.
    """
    frames, bad, at, end = [], 0, 0, len(data)
    while at < end:
        marker = data[at]
        if marker not in (MARKER, MARKER_V1):
            next_marker = _MARKERS.search(data, at)
            at, bad = next_marker.start() if next_marker else end, bad + 1
            continue
        if end - at < _LENGTH_KNOWN:
            break
        stop = at + frame_bytes(data, at)
        if stop > end:
            break
        flags = data[at + 2] if marker == MARKER else 0
        checked = stop - SIGNATURE_BYTES if flags & SIGNED else stop
        # frames with unknown flags are rejected, because their layout is unknown
        if not flags & ~SIGNED and _is_intact(data, at, checked):
            frames.append(data[at:stop])
        else:
            bad += 1
        at = stop
    return frames, at, bad


def frame_bytes(data: bytes, start: int) -> int:
    """Return the length of the frame whose first three bytes are at `start`; 0 if no frame begins there."""
    if data[start] == MARKER_V1:
        return HEADER_BYTES_V1 + data[start + 1] + CHECKSUM_BYTES
    if data[start] != MARKER:
        return 0
    signed = SIGNATURE_BYTES if data[start + 2] & SIGNED else 0
    return HEADER_BYTES + data[start + 1] + CHECKSUM_BYTES + signed


class Frames:
    """Cuts a stream of bytes into units: each MAVLink frame, and each stretch of bytes between frames."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the units that are complete, in order. Messages are not read, and checksums are not checked."""
        data = self._rest + data
        units, at = [], 0
        while at < len(data):
            marker = _MARKERS.search(data, at)
            if marker is None or marker.start() > at:
                stop = marker.start() if marker else len(data)
            elif len(data) - at < _LENGTH_KNOWN or (stop := at + frame_bytes(data, at)) > len(data):
                break
            units.append(data[at:stop])
            at = stop
        self._rest = data[at:]
        return units


def is_frame(unit: bytes) -> bool:
    """Return whether a unit of `Frames` is a frame."""
    return unit[0] in (MARKER, MARKER_V1)


def message_id(data: bytes, at: int = 0) -> int:
    """Return the message id in the header of the frame at `at`."""
    if data[at] == MARKER_V1:
        return data[at + 5]
    return data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16


def _is_intact(data: bytes, at: int, stop: int) -> bool:
    """Return whether the frame from `at` to `stop` has a known message and a correct checksum."""
    try:
        extra = BY_ID[message_id(data, at)].extra
    except KeyError:
        return False
    computed: int = checksum(data[at + 1 : stop - CHECKSUM_BYTES] + extra)
    return computed == data[stop - 2] | data[stop - 1] << 8


def is_plain(frame: bytes) -> bool:
    """Return whether a frame is MAVLink 2 without a signature."""
    return frame[0] == MARKER and frame[2] == 0


def message(frame: bytes) -> Any:
    """Return the message in a plain intact frame."""
    return BY_ID[message_id(frame)].message(frame)


def logged_frames(data: bytes) -> tuple[list[tuple[int, bytes]], int]:
    """Return the (µs, frame) pairs in a part of a tlog, and the offset of the rest, which has no complete frame.

    A tlog has frames of MAVLink 1 or 2, each after eight bytes of time. Frames are found by their lengths.
    Garbage is skipped. Only a frame right after garbage is checked for damage; the caller checks the other frames.
    """
    frames, at, end, lost = [], 0, len(data), False
    while end - at >= _SHORTEST_LOGGED:
        start = at + _LOG_TIME.size
        stop = start + frame_bytes(data, start)
        time_us = _LOG_TIME.unpack_from(data, at)[0]
        if stop == start or time_us >= _SANE_US:
            lost, at = True, at + 1
            continue
        if stop > end:
            break
        frame = data[start:stop]
        if lost and scan(frame)[0] != [frame]:
            at += 1
            continue
        frames.append((time_us, frame))
        lost, at = False, stop
    return frames, at


def newest(data: bytes, message_id: int, count: int) -> bytes:
    """Return the last `count` frames with this message id from each system, in the order of `data`.

    `data` must consist of complete unsigned MAVLink 2 frames. Other data is returned unchanged, for a parser.
    """
    low, middle, high = message_id & 0xFF, message_id >> 8 & 0xFF, message_id >> 16
    of_system: dict[int, list[int]] = {}
    at, end = 0, len(data)
    while at < end:
        if end - at < HEADER_BYTES + CHECKSUM_BYTES or data[at] != MARKER or data[at + 2] != 0:
            return data
        if data[at + 7] == low and data[at + 8] == middle and data[at + 9] == high:
            of_system.setdefault(data[at + 5], []).append(at)
        at += HEADER_BYTES + CHECKSUM_BYTES + data[at + 1]
    if at != end:
        return data
    wanted = sorted(start for starts in of_system.values() for start in starts[-count:])
    return b"".join(data[start : start + HEADER_BYTES + CHECKSUM_BYTES + data[start + 1]] for start in wanted)
