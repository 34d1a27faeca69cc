"""Files that somebody else is writing, read as they grow: whole lines and whole MAVLink frames, each once.

Nothing here waits or locks, and the writer never learns that somebody reads. A file that is not there yet is empty.
"""

import struct
from pathlib import Path

from foundation import wire

AT_ONCE = 4_000_000  # bytes that are taken at a time: of a flight that has long begun the rest comes with the next
TIME = struct.Struct(">Q")
SANE_US = 1 << 56  # a time beyond it is none: two thousand years
SHORTEST = TIME.size + wire.HEADER_BYTES + wire.CHECKSUM_BYTES


class GrowingFile:
    """The bytes that have come since the last time."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0

    def read(self) -> bytes:
        """Return what has come, AT_ONCE at most; nothing where the file cannot be read."""
        try:
            if self._path.stat().st_size <= self._at:
                return b""
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read(AT_ONCE)
        except OSError:
            return b""
        self._at += len(data)
        return data


class LineTail:
    """The lines of a log."""

    def __init__(self, path: Path) -> None:
        self._file, self._rest = GrowingFile(path), b""

    def read(self) -> list[bytes]:
        """Return the lines that have been finished since the last time, without their ends."""
        data = self._file.read()
        if not data:
            return []
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


class FrameTail:
    """The frames of a tlog."""

    def __init__(self, path: Path) -> None:
        self._file, self._rest = GrowingFile(path), b""

    def read(self) -> list[tuple[int, bytes]]:
        """Return (µs of the vehicle's clock, MAVLink 2 frame) of the frames that have been finished since then.

        Only the length of a frame is looked at, unless the bytes before it made no sense: what is taken from it is
        checked by whoever takes it. Bytes that are no frames are passed over.
        """
        data = self._rest + self._file.read()
        found, at, end, lost = [], 0, len(data), False
        while end - at >= SHORTEST:
            start = at + TIME.size
            stop = start + _length(data, start)
            time_us = TIME.unpack_from(data, at)[0]
            if stop == start or time_us >= SANE_US:
                lost, at = True, at + 1
                continue
            if stop > end:
                break  # its end has not come
            frame = data[start:stop]
            if lost and not intact(frame):
                at += 1
                continue
            found.append((time_us, frame))
            lost, at = False, stop
        self._rest = data[at:]
        return found


def intact(frame: bytes) -> bool:
    """Return whether a MAVLink 2 frame is one of a message that we know, and undamaged."""
    return wire.scan(frame)[0] == [frame]


def _length(data: bytes, start: int) -> int:
    """Return how long the frame is that begins there, 0 where none does."""
    if data[start] != wire.MARKER:
        return 0
    signed = wire.SIGNATURE_BYTES if data[start + 2] & wire.SIGNED else 0
    return wire.HEADER_BYTES + data[start + 1] + wire.CHECKSUM_BYTES + signed
