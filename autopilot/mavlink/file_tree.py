"""The files that MAVLink FTP shows: the vehicle's memory card and logs at PX4's places, and the parameters as a file.

    /@PARAM/param.pck      made at the moment it is opened
    /fs/microsd/…          the memory card; clients may make, rename and remove files and folders in it
    /fs/microsd/log/…      the log folder; clients may do the same there
    /@MAV_LOG/…            another name for the log folder, which does not depend on the autopilot

Clients cannot name anything outside these two folders: not with `..`, not through a link. What they store is limited.
"""

import errno
import io
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from autopilot.logging.directory import LogDirectory

FAIL, FAIL_ERRNO, INVALID_DATA_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE = 1, 2, 3, 4, 5, 6
UNKNOWN_COMMAND, FILE_EXISTS, FILE_PROTECTED, FILE_NOT_FOUND = 7, 8, 9, 10

CARD = ("fs", "microsd")
LOGS = (*CARD, "log")
LOGS_ANYWHERE = "@MAV_LOG"
PARAMETERS = ("@PARAM", "param.pck")
LARGEST = 64 << 20  # bytes: what a client may write into one file
CARD_BYTES = 1 << 30  # bytes on the card and in the log folder, from which on a client may not begin to write
CARD_ENTRIES = 4096  # files and folders, likewise


class Refusal(Exception):  # noqa: N818 - not an error of ours: the answer to a request
    """A request that cannot be fulfilled, with the code (and errno) of its NAK."""

    def __init__(self, code: int, errno: int | None = None) -> None:
        super().__init__(code)
        self.data = bytes([code]) if errno is None else bytes([code, errno & 0xFF])


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a directory."""

    name: str
    size: int | None  # bytes; None for a folder
    time_utc: int = 0  # s since 1970; 0 = unknown


def checksum(file: BinaryIO) -> int:
    """Return MAVLink FTP's CRC-32: the polynomial of zlib, begun with 0 and not inverted."""
    crc = 0xFFFFFFFF  # zlib inverts before and after
    while data := file.read(1 << 16):
        crc = zlib.crc32(data, crc)
    return crc ^ 0xFFFFFFFF


class FileTree:
    """Turns names of the protocol into files. Every method raises Refusal, or OSError from the disk."""

    def __init__(
        self, logs: LogDirectory | None, parameter_file: Callable[[], bytes], card: Path | None = None
    ) -> None:
        """`logs` and `card` are folders that exist; None: there is nothing at their places."""
        self._logs = logs
        self._parameter_file = parameter_file
        self._card = card

    def entries(self, name: bytes) -> list[Entry]:
        """Return what a folder holds, sorted by name."""
        parts = _parts(name)
        if not parts:
            return [Entry(PARAMETERS[0], None), Entry(LOGS[0], None)]
        if parts == PARAMETERS[:1]:
            return [Entry(PARAMETERS[1], len(self._parameter_file()))]
        if parts == CARD[:1]:
            return [Entry(CARD[1], None)]
        found = [Entry(LOGS[2], None)] if parts == CARD and self._logs is not None else []
        if parts == CARD and self._card is None:
            return found
        for path in self._real(parts).iterdir():
            if path.is_symlink() or not (path.is_file() or path.is_dir()):
                continue
            stat = path.stat()
            found.append(Entry(path.name, None if path.is_dir() else stat.st_size, max(int(stat.st_mtime), 0)))
        return sorted(found, key=lambda entry: entry.name)

    def open_to_read(self, name: bytes) -> tuple[BinaryIO, int]:
        """Return an open file and its size."""
        parts = _parts(name)
        if parts == PARAMETERS:
            data = self._parameter_file()
            return io.BytesIO(data), len(data)
        path = self._real(parts)
        if not path.is_file():
            raise Refusal(FILE_NOT_FOUND)
        return path.open("rb"), path.stat().st_size

    def open_to_write(self, name: bytes, *, empty: bool) -> BinaryIO:
        """Return a file open for writing, made when it does not exist; `empty` discards what was in it."""
        path = self._changeable(name)
        if path.is_dir():
            raise Refusal(FILE_PROTECTED)
        self._check_space()
        return path.open("wb" if empty or not path.exists() else "r+b")

    def truncate(self, name: bytes, size: int) -> None:
        """Cut a file, or extend it with zeros."""
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
        """Make a folder in one that exists."""
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
        """Give a file or folder another name that is not taken."""
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

    def _real(self, parts: tuple[str, ...]) -> Path:
        if parts[: len(LOGS)] == LOGS:
            folder, below = self._logs.folder if self._logs is not None else None, parts[len(LOGS) :]
        else:
            folder, below = self._card if parts[: len(CARD)] == CARD else None, parts[len(CARD) :]
        if folder is None:
            raise Refusal(FILE_NOT_FOUND)
        root = folder.resolve()
        path = root.joinpath(*below)
        if not path.resolve().is_relative_to(root):
            raise Refusal(FILE_NOT_FOUND)
        return path

    def _changeable(self, name: bytes) -> Path:
        parts = _parts(name)
        if parts == LOGS[: len(parts)] or parts[:1] == PARAMETERS[:1]:
            raise Refusal(FILE_PROTECTED)
        path = self._real(parts)
        active = self._logs.active if self._logs is not None else None
        if active is not None and path.resolve() == active.resolve():
            raise Refusal(FILE_PROTECTED)
        return path

    def _check_space(self) -> None:
        """Raise Refusal when card and log folder together are full."""
        size = entries = 0
        for folder in (self._card, self._logs.folder if self._logs is not None else None):
            for root, folders, files in os.walk(folder) if folder is not None else ():
                entries += len(folders) + len(files)
                size += sum((Path(root) / name).lstat().st_size for name in files)
        if size >= CARD_BYTES or entries >= CARD_ENTRIES:
            raise Refusal(FAIL_ERRNO, errno.ENOSPC)


def _parts(name: bytes) -> tuple[str, ...]:
    """Return the folders and the file of a name, without the options that some clients add after a question mark."""
    try:
        text = name.decode()
    except UnicodeDecodeError:
        raise Refusal(FILE_NOT_FOUND) from None
    if text.startswith("@"):
        text = text.partition("?")[0]
    parts = tuple(part for part in text.split("/") if part not in ("", "."))
    if ".." in parts or "\\" in text or not text.isprintable():
        raise Refusal(FILE_NOT_FOUND)
    return LOGS + parts[1:] if parts[:1] == (LOGS_ANYWHERE,) else parts
