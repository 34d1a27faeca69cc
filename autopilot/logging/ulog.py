"""The ULog file format, version 1: the messages of our flight logs as little-endian bytes. No I/O.

Source: the ULog specification in PX4's documentation (docs.px4.io, dev_log/ulog_file_format).
"""

import re
import struct

MAGIC = bytes((0x55, 0x4C, 0x6F, 0x67, 0x01, 0x12, 0x35))
VERSION = 1

_HEAD = struct.Struct("<HB")  # size of the payload, type of the message
_CODES = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I",
    "int64_t": "q", "uint64_t": "Q", "float": "f", "double": "d", "bool": "?",
}  # fmt: skip
_FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")


def _message(kind: str, payload: bytes) -> bytes:
    return _HEAD.pack(len(payload), ord(kind)) + payload


def header(time_us: int) -> bytes:
    """Return the file header and the message of flag bits, all 0. `time_us`: start of the log, vehicle clock."""
    return MAGIC + struct.pack("<BQ", VERSION, time_us) + _message("B", bytes(40))


def layout(fields: str) -> str:
    """Return the struct codes of a field list such as `uint64_t timestamp;float[4] q`. Raises ValueError if invalid."""
    codes = ""
    for field in fields.split(";"):
        match = _FIELD.fullmatch(field)
        if match is None or match[1] not in _CODES:
            raise ValueError(f"{field!r} is no field of a ULog format")
        codes += (match[2] or "") + _CODES[match[1]]
    return codes


def definition(name: str, fields: str) -> bytes:
    """Return the format definition of a topic."""
    return _message("F", f"{name}:{fields};".encode())


def _keyed(kind: str, key: str, value: bytes) -> bytes:
    name = key.encode()
    return _message(kind, bytes([len(name)]) + name + value)


def information(key: str, value: str | int) -> bytes:
    """Return an information message: a text, or a number below 2³²."""
    if isinstance(value, int):
        return _keyed("I", f"uint32_t {key}", struct.pack("<I", value))
    data = value.encode()
    return _keyed("I", f"char[{len(data)}] {key}", data)


def parameter(name: str, value: int | float) -> bytes:
    """Return the value of a parameter: INT32 for an int, REAL32 for a float."""
    if isinstance(value, int):
        return _keyed("P", f"int32_t {name}", struct.pack("<i", value))
    return _keyed("P", f"float {name}", struct.pack("<f", value))


def subscription(number: int, name: str, instance: int = 0) -> bytes:
    """Return the subscription message: data messages with this `number` belong to this instance of topic `name`."""
    return _message("A", struct.pack("<BH", instance, number) + name.encode())


def text(severity: int, time_us: int, words: str) -> bytes:
    """Return a logged string, at most 1000 bytes; `severity` is a MAV_SEVERITY, 0 (emergency) to 7 (debug)."""
    return _message("L", struct.pack("<BQ", ord("0") + severity, time_us) + words.encode()[:1000])


def dropout(milliseconds: int) -> bytes:
    """Return the dropout message: data were lost for this time."""
    return _message("O", struct.pack("<H", min(milliseconds, 65_535)))


class DataPacker:
    """Packs the samples of one topic: message head and fields in a single call."""

    def __init__(self, number: int, fields: str) -> None:
        self._struct = struct.Struct("<HBH" + layout(fields))
        self._size = self._struct.size - _HEAD.size
        self._number = number

    def pack(self, values: tuple[float, ...]) -> bytes:
        """Return a data message. Raises struct.error or OverflowError for a value that its field cannot hold."""
        return self._struct.pack(self._size, 68, self._number, *values)  # 68: 'D'
