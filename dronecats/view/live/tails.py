"""Files that somebody else is writing, read as they grow: whole lines and whole MAVLink frames, each once.

Nothing here waits or locks, and the writer never learns that somebody reads. A file that is not there yet is empty.
"""

from pathlib import Path

from foundation import wire

AT_ONCE = 4_000_000  # bytes that are taken at a time: of a flight that has long begun the rest comes with the next


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
        """Return (µs of the vehicle's clock, MAVLink 2 frame) of the frames that have been finished since then."""
        data = self._rest + self._file.read()
        frames, rest = wire.logged_frames(data)
        self._rest = data[rest:]
        return [(time_us, frame) for time_us, frame in frames if frame[0] == wire.MARKER]


def intact(frame: bytes) -> bool:
    """Return whether a MAVLink 2 frame is one of a message that we know, and undamaged."""
    return wire.scan(frame)[0] == [frame]
