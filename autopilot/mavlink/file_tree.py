"""The files of MAVLink FTP: the vehicle's memory card and logs at the paths of PX4, and a file of the parameters.

    /@PARAM/param.pck      the parameters; created each time it is opened
    /fs/microsd/…          the memory card; clients may create, rename and remove files and folders in it
    /fs/microsd/log/…      the log folder, which clients may change too
    /@MAV_LOG/…            the log folder under MAVLink's standard name

Clients cannot leave the card and the log folder, neither with `..` nor through a link. The space and the number of
files are limited.

To read the parameters, MAVProxy and pymavlink request param.pck first. Source of the format: ArduPilot, AP_Filesystem
documentation. A record of this file has type, name and value. The name omits the first letters that the previous name
has too.

A session is a file that a client holds open. The last answer to each client is kept, to send it again if it was lost.
"""

import errno
import io
import os
import struct
import zlib
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import BinaryIO

from autopilot.logging.flight_log import LogDirectory
from autopilot.parameters import ParameterTable

MAGIC = 0x671B
INT32, FLOAT = 3, 4


def packed(parameters: ParameterTable) -> bytes:
    """Return the content of param.pck: a header with the count, then all parameters, sorted by name."""
    count = len(parameters)
    records = [struct.pack("<HHH", MAGIC, count, count)]
    before = ""
    for name in parameters.names:
        equal_letters = takewhile(lambda pair: pair[0] == pair[1], zip(before, name, strict=False))
        shared = min(sum(1 for _ in equal_letters), len(name) - 1, 15)
        rest = name[shared:].encode()
        integer = parameters.is_integer(name)
        head = bytes((INT32 if integer else FLOAT, shared | (len(rest) - 1) << 4))
        value = struct.pack("<i", int(parameters[name])) if integer else struct.pack("<f", parameters[name])
        records.append(head + rest + value)
        before = name
    return b"".join(records)


FAIL, FAIL_ERRNO, INVALID_DATA_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE = 1, 2, 3, 4, 5, 6
UNKNOWN_COMMAND, FILE_EXISTS, FILE_PROTECTED, FILE_NOT_FOUND = 7, 8, 9, 10

CARD = ("fs", "microsd")
LOGS = (*CARD, "log")
LOGS_ANYWHERE = "@MAV_LOG"
PARAMETERS = ("@PARAM", "param.pck")
LARGEST = 64 << 20  # bytes, upper limit of a file that a client writes
CARD_BYTES = 1 << 30  # card and log folder together; at this size, clients cannot create files or open them to write
CARD_ENTRIES = 4096  # limit for the number of files and folders in both


class Refusal(Exception):  # noqa: N818 - not an error of ours: the answer to a request
    """A request that cannot be fulfilled, with the code (and errno) of its NAK."""

    def __init__(self, code: int, errno: int | None = None) -> None:
        super().__init__(code)
        self.data = bytes([code]) if errno is None else bytes([code, errno & 0xFF])


@dataclass(frozen=True, slots=True)
class Entry:
    """One entry of a folder."""

    name: str
    size: int | None  # bytes; None for a folder
    time_utc: int = 0  # s since 1970; 0 = unknown


def checksum(file: BinaryIO) -> int:
    """Return MAVLink FTP's CRC-32: the polynomial of zlib, but with start value 0 and without inversion."""
    crc = 0xFFFFFFFF  # zlib inverts before and after
    while data := file.read(1 << 16):
        crc = zlib.crc32(data, crc)
    return crc ^ 0xFFFFFFFF


class FileTree:
    """Accesses files by their names in the protocol. Every method may raise Refusal, and OSError from the disk."""

    def __init__(
        self, logs: LogDirectory | None, parameter_file: Callable[[], bytes], card: Path | None = None
    ) -> None:
        """`logs` and `card` are existing folders; clients see no files of a folder that is None."""
        self._logs = logs
        self._parameter_file = parameter_file
        self._card = card

    def entries(self, name: bytes) -> list[Entry]:
        """Return the entries of a folder, sorted by name."""
        segments = _segments(name)
        if not segments:
            return [Entry(PARAMETERS[0], None), Entry(LOGS[0], None)]
        if segments == PARAMETERS[:1]:
            return [Entry(PARAMETERS[1], len(self._parameter_file()))]
        if segments == CARD[:1]:
            return [Entry(CARD[1], None)]
        entries = [Entry(LOGS[2], None)] if segments == CARD and self._logs is not None else []
        if segments == CARD and self._card is None:
            return entries
        for path in self._real(segments).iterdir():
            if path.is_symlink() or not (path.is_file() or path.is_dir()):
                continue
            stat = path.stat()
            entries.append(Entry(path.name, None if path.is_dir() else stat.st_size, max(int(stat.st_mtime), 0)))
        return sorted(entries, key=lambda entry: entry.name)

    def open_to_read(self, name: bytes) -> tuple[BinaryIO, int]:
        """Return an open file and its size."""
        segments = _segments(name)
        if segments == PARAMETERS:
            data = self._parameter_file()
            return io.BytesIO(data), len(data)
        path = self._real(segments)
        if not path.is_file():
            raise Refusal(FILE_NOT_FOUND)
        return path.open("rb"), path.stat().st_size

    def open_to_write(self, name: bytes, *, empty: bool) -> BinaryIO:
        """Return a file open for writing. A missing file is created. `empty`: discard its content."""
        path = self._changeable(name)
        if path.is_dir():
            raise Refusal(FILE_PROTECTED)
        self._check_space()
        return path.open("wb" if empty or not path.exists() else "r+b")

    def truncate(self, name: bytes, size: int) -> None:
        """Set the size of a file: cut it, or extend it with zeros."""
        path = self._changeable(name)
        if not path.is_file():
            raise Refusal(FILE_NOT_FOUND)
        if size > LARGEST:
            raise Refusal(FAIL)
        self._check_space()
        with path.open("r+b") as file:
            file.truncate(size)

    def remove_file(self, name: bytes) -> None:
        """Remove a file."""
        path = self._changeable(name)
        if path.is_dir():
            raise Refusal(FAIL)
        path.unlink()

    def make_folder(self, name: bytes) -> None:
        """Create a folder in an existing folder."""
        path = self._changeable(name)
        self._check_space()
        path.mkdir()

    def remove_folder(self, name: bytes) -> None:
        """Remove an empty folder."""
        path = self._changeable(name)
        if path.is_file():
            raise Refusal(FAIL)
        path.rmdir()

    def rename(self, old: bytes, new: bytes) -> None:
        """Rename a file or folder. The new name must be free."""
        source, target = self._changeable(old), self._changeable(new)
        if not source.exists():
            raise Refusal(FILE_NOT_FOUND)
        if target.exists():
            raise Refusal(FILE_EXISTS)
        source.rename(target)

    def checksum(self, name: bytes) -> int:
        """Return the checksum of a file's content."""
        file, _ = self.open_to_read(name)
        with file:
            return checksum(file)

    def _real(self, segments: tuple[str, ...]) -> Path:
        if segments[: len(LOGS)] == LOGS:
            folder, below = self._logs.folder if self._logs is not None else None, segments[len(LOGS) :]
        else:
            folder, below = self._card if segments[: len(CARD)] == CARD else None, segments[len(CARD) :]
        if folder is None:
            raise Refusal(FILE_NOT_FOUND)
        root = folder.resolve()
        path = root.joinpath(*below)
        if not path.resolve().is_relative_to(root):
            raise Refusal(FILE_NOT_FOUND)
        return path

    def _changeable(self, name: bytes) -> Path:
        segments = _segments(name)
        if segments == LOGS[: len(segments)] or segments[:1] == PARAMETERS[:1]:
            raise Refusal(FILE_PROTECTED)
        path = self._real(segments)
        active = self._logs.active if self._logs is not None else None
        if active is not None and path.resolve() == active.resolve():
            raise Refusal(FILE_PROTECTED)
        return path

    def _check_space(self) -> None:
        """Raise Refusal when card and log folder together have reached CARD_BYTES or CARD_ENTRIES."""
        size = entries = 0
        for folder in (self._card, self._logs.folder if self._logs is not None else None):
            for root, folders, files in os.walk(folder) if folder is not None else ():
                entries += len(folders) + len(files)
                size += sum((Path(root) / name).lstat().st_size for name in files)
        if size >= CARD_BYTES or entries >= CARD_ENTRIES:
            raise Refusal(FAIL_ERRNO, errno.ENOSPC)


def _segments(name: bytes) -> tuple[str, ...]:
    """Return the parts of a path, without the options after a ? that some clients add to paths with @."""
    try:
        text = name.decode()
    except UnicodeDecodeError:
        raise Refusal(FILE_NOT_FOUND) from None
    if text.startswith("@"):
        text = text.partition("?")[0]
    segments = tuple(part for part in text.split("/") if part not in ("", "."))
    if ".." in segments or "\\" in text or not text.isprintable():
        raise Refusal(FILE_NOT_FOUND)
    return LOGS + segments[1:] if segments[:1] == (LOGS_ANYWHERE,) else segments


MOST = 16  # largest number of open sessions
IDLE_US = 30_000_000  # µs; a session that was unused for this time may be closed to make room for another
REMEMBERED = 32  # clients whose last answer is kept

Client = Hashable  # a port and the sender's ids


@dataclass(slots=True)
class FileSession:
    """An open file of one client."""

    file: BinaryIO
    writable: bool
    used_us: int


class FileSessions:
    """The sessions of all clients, and the last answer to each client."""

    def __init__(self) -> None:
        self._open: dict[tuple[Client, int], FileSession] = {}
        self._answers: dict[Client, tuple[bytes, bytes]] = {}

    def __len__(self) -> int:
        return len(self._open)

    def make_room(self, now_us: int) -> None:
        """Close an idle session if MOST sessions are open. Raises Refusal if none is idle."""
        if len(self._open) < MOST:
            return
        key, oldest = min(self._open.items(), key=lambda item: item[1].used_us)
        if now_us - oldest.used_us < IDLE_US:
            raise Refusal(NO_SESSIONS)
        self._close(key)

    def open(self, client: Client, wish: int, file: BinaryIO, writable: bool, now_us: int) -> int:
        """Keep a file open, and return the number of its session: `wish`, or the next free number."""
        number = wish
        while (client, number) in self._open:
            number = (number + 1) % 256
        self._open[client, number] = FileSession(file, writable, now_us)
        return number

    def get(self, client: Client, number: int, now_us: int) -> FileSession:
        """Return an open session. Raises Refusal when the client has no such session."""
        session = self._open.get((client, number))
        if session is None:
            raise Refusal(INVALID_SESSION)
        session.used_us = now_us
        return session

    def close(self, client: Client, number: int) -> None:
        """End one session. Raises Refusal when the client has no such session."""
        if (client, number) not in self._open:
            raise Refusal(INVALID_SESSION)
        self._close((client, number))

    def reset(self, client: Client) -> None:
        """End all sessions of a client."""
        for key in [key for key in self._open if key[0] == client]:
            self._close(key)

    def answered(self, client: Client, request: bytes) -> bytes | None:
        """Return the previous answer if a client repeats its last request, None otherwise."""
        last, answer = self._answers.get(client, (b"", b""))
        return answer if last == request else None

    def remember(self, client: Client, request: bytes, answer: bytes) -> None:
        """Keep the answer to a client's last request."""
        self._answers.pop(client, None)
        self._answers[client] = (request, answer)
        if len(self._answers) > REMEMBERED:
            del self._answers[next(iter(self._answers))]

    def _close(self, key: tuple[Client, int]) -> None:
        self._open.pop(key).file.close()
