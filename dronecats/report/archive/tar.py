"""A tar in an xz, written so that the same files are the same bytes, and read as if somebody meant harm.

The reader knows plain files in the ustar format and nothing else: no links, no devices, no headers that change others.
It hands on names and bytes and writes nothing itself.
"""

import lzma
import tarfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from foundation.errors import UsageError

BLOCK = 512  # bytes
CHUNK = 1 << 20
MEMORY_MAX = 128 << 20  # bytes that unpacking may take; a stream may ask for 4 GB
RATIO_MAX = 2000  # bytes out of one in; logs come to less than a hundred
RATIO_FROM = 64 << 20  # bytes out from which that is looked at
TOTAL_MAX = 64 << 30  # bytes, frames included


@dataclass(slots=True)
class Packed:
    """A file of an archive, to be read once, before the next."""

    name: str
    size: int  # bytes
    _source: "Unxz"
    _left: int

    def chunks(self) -> Iterator[bytes]:
        """Yield its bytes in pieces. Raises UsageError where the archive is cut off."""
        while self._left:
            piece = self._source.exactly(min(CHUNK, self._left))
            self._left -= len(piece)
            yield piece

    def skip(self) -> None:
        """Read to the end of it, and of its last block."""
        for _ in self.chunks():
            pass
        if self._source.exactly(-self.size % BLOCK).strip(b"\0"):
            raise UsageError(f"the archive is damaged: something stands behind {self.name[:80]!r}")


class Unxz:
    """The bytes of an xz, no more of them than are asked for and than anybody could have meant."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._xz = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=MEMORY_MAX)
        self._in = self._out = 0

    def exactly(self, count: int) -> bytes:
        """Return the next `count` bytes. Raises UsageError when there are fewer, or too many behind too little."""
        told = self.at_most(count)
        if len(told) != count:
            raise UsageError("the archive is cut off")
        return told

    def at_most(self, count: int) -> bytes:
        """Return the next `count` bytes, fewer at the end. Raises UsageError."""
        parts: list[bytes] = []
        missing = count
        while missing and not self._xz.eof:
            packed = b""
            if self._xz.needs_input:
                packed = self._file.read(CHUNK)
                self._in += len(packed)
                if not packed:
                    raise UsageError("the archive is cut off")
            try:
                parts.append(self._xz.decompress(packed, missing))
            except lzma.LZMAError as wrong:
                raise UsageError(f"the archive cannot be unpacked: {str(wrong).lower()}") from None
            missing -= len(parts[-1])
            self._out += len(parts[-1])
            if self._out > TOTAL_MAX or (self._out > RATIO_FROM and self._out > RATIO_MAX * self._in):
                raise UsageError("the archive unpacks to more than flights can be")
        return b"".join(parts)

    def ends(self) -> bool:
        """Return whether nothing stands behind."""
        return self._xz.eof and not self._xz.unused_data and not self._file.read(1)


def read(file: BinaryIO) -> Iterator[Packed]:
    """Yield the files of an archive in their order, each name once. Raises UsageError for whatever is none."""
    source, names = Unxz(file), set[str]()
    while True:
        header = source.exactly(BLOCK)
        if not header.strip(b"\0"):
            break
        packed = _packed(header, source)
        if packed.name in names:
            raise UsageError(f"the archive holds {packed.name[:80]!r} twice")
        names.add(packed.name)
        yield packed
        packed.skip()
    while rest := source.at_most(CHUNK):
        if rest.strip(b"\0"):
            raise UsageError("the archive is damaged: something stands behind its end")
    if not source.ends():
        raise UsageError("the archive is damaged: something stands behind its end")


def write(path: Path, files: Iterable[tuple[str, Callable[[], bytes]]]) -> None:
    """Write an archive of (name, what makes its bytes), in this order. Raises OSError."""
    with (
        lzma.open(path, "wb", format=lzma.FORMAT_XZ, preset=6) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name, made in files:
            data = made()
            entry = tarfile.TarInfo(name)  # of nobody, of no time
            entry.size, entry.mode, entry.mtime = len(data), 0o644, 0
            tar.addfile(entry, BytesIO(data))


def _packed(header: bytes, source: Unxz) -> Packed:
    """Return the file that a header tells of. POSIX.1-1988, "ustar"."""
    sum_of = sum(header[:148]) + 8 * ord(" ") + sum(header[156:])
    if header[257:265] != b"ustar\x0000" or _octal(header[148:156]) != sum_of:
        raise UsageError("the archive holds something that is no tar of plain files")
    if header[156:157] != b"0":
        raise UsageError("the archive holds something that is no plain file, a link or a folder")
    name, prefix = (part.split(b"\0", 1)[0] for part in (header[:100], header[345:500]))
    try:
        told = (prefix + b"/" + name if prefix else name).decode("ascii")
    except UnicodeDecodeError:
        raise UsageError("the archive holds a file whose name is none of a run's") from None
    size = _octal(header[124:136])
    if size is None:
        raise UsageError(f"the archive is damaged: the size of {told[:80]!r} is no number")
    return Packed(told, size, source, size)


def _octal(field: bytes) -> int | None:
    digits = field.rstrip(b" \0")
    return int(digits, 8) if digits and not digits.strip(b"01234567") else None
