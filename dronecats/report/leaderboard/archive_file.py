"""Reads and writes archives of runs: tar files with a manifest and logs, compressed with xz."""

import hashlib
import lzma
import re
import tarfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import msgspec
from msgspec import Meta

from foundation.conversion import convert, decode
from foundation.errors import UsageError
from foundation.run_folder import layout

SCHEMA = 1  # version of the format; it increases when a field changes its meaning
MANIFEST = "manifest.json"
NAME_CHARS, NOTE_CHARS = 80, 500

_EPISODE = r"[a-z0-9](?:[a-z0-9-]{0,62}[a-z0-9])?"
_OF_RUN = r"runs/[0-9]{2}"
_OF_EPISODE = rf"{_OF_RUN}/{_EPISODE}"
LOGS = (
    "episode.json", "identity.json", "decisions.jsonl", "truth.jsonl", "verdict.json", "commander.jsonl",
    "estimate.jsonl",
)  # fmt: skip
LOG = re.compile(rf"{_OF_RUN}/run\.json|{_OF_EPISODE}/(?:{'|'.join(map(re.escape, LOGS))})")
FRAME = re.compile(rf"{_OF_EPISODE}/frames/[0-9]{{6,9}}(?:_d[0-9]{{1,3}})?\.jpg")
OMITTED_FILE = re.compile(rf"{_OF_EPISODE}/(?:frames/|flight\.tlog)")
EPISODE_NAME = re.compile(_EPISODE)

Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
Name = Annotated[str, Meta(min_length=1, max_length=NAME_CHARS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FileDigest:
    """The digest of a file; for a folder (name with / at the end), the digest of the output of `sha256sum *` in it."""

    bytes: Annotated[int, Meta(ge=0)]
    sha256: Sha256
    files: Annotated[int, Meta(ge=0)] | None = None  # number of files in a folder; None: a file


@dataclass(frozen=True, slots=True, kw_only=True)
class SubmittedRun:
    """One run in an archive. Every episode of the run is flown once."""

    folder: Annotated[str, Meta(pattern=f"^{_OF_RUN}$")]
    seed: int
    episodes: tuple[Annotated[str, Meta(pattern=f"^{_EPISODE}$")], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """The contents of manifest.json, the first file of an archive."""

    schema: int
    name: Name  # name of the entry
    note: Annotated[str, Meta(max_length=NOTE_CHARS)]
    pilot: str  # built-in pilot, or PROVIDER/NAME of the model
    is_model: bool
    identity: Sha256  # digest of the settings that the runs share (`dronecats.report.results.identity`)
    suite: str | None  # name of the set of episodes that every run has completely; None: no set
    partial: str | None  # a sentence about what is missing or broken; None: the suite is complete and scored
    runs: tuple[SubmittedRun, ...]
    files: dict[str, FileDigest]  # the other files in the archive, by name
    left_out: dict[str, FileDigest]  # files of the runs that are not in the archive, by name
    scrubbed: tuple[str, ...]  # files in which `submit` replaced an API key or an absolute path
    dronecats: str  # version of dronecats that wrote the archive

    def encoded(self) -> bytes:
        """Return the contents of manifest.json."""
        return msgspec.json.format(msgspec.json.encode(self, order="deterministic"), indent=1) + b"\n"


def decoded(data: bytes) -> Manifest:
    """Parse the contents of manifest.json. Raises UsageError for a damaged or newer manifest."""
    try:
        content: Any = decode(data, object)
        version = content.get("schema") if isinstance(content, dict) else None
        if isinstance(version, int) and version > SCHEMA:
            raise UsageError(
                f"the archive is of a newer dronecats: it has version {version}, and this one reads {SCHEMA}."
                " Update dronecats"
            )
        manifest = convert(content, Manifest)
        unknown = content.keys() - Manifest.__dataclass_fields__.keys()
    except (msgspec.DecodeError, UnicodeError, RecursionError) as wrong:
        raise UsageError(f"{MANIFEST} of the archive is damaged: {wrong}") from None
    if unknown:
        raise UsageError(f"{MANIFEST} of the archive is damaged: {sorted(unknown)[0][:40]!r} is not known")
    texts = (manifest.name, manifest.note, manifest.pilot, manifest.suite, manifest.partial, manifest.dronecats)
    for text in texts:
        if text and not text.isprintable():
            raise UsageError(f"{MANIFEST} of the archive is damaged: it has text that cannot be printed")
    for path in manifest.files:
        if not (LOG.fullmatch(path) or FRAME.fullmatch(path)):
            raise UsageError(f"the archive names {path[:80]!r}, which is not a file of a run")
    for path in manifest.left_out:
        if not OMITTED_FILE.fullmatch(path):
            raise UsageError(f"the archive names {path[:80]!r} as omitted, which is not a file of a run")
    return manifest


BLOCK = 512  # bytes
CHUNK = 1 << 20
MEMORY_MAX = 128 << 20  # bytes, limit of the memory for unpacking; an xz file may request 4 GB
RATIO_MAX = 2000  # largest ratio of unpacked to packed bytes; logs have less than 100
RATIO_FROM = 64 << 20  # unpacked bytes from which the ratio is checked
TOTAL_MAX = 64 << 30  # unpacked bytes, including frames


@dataclass(slots=True)
class ArchiveMember:
    """A file in an archive. It can be read only once, and only before the next file."""

    name: str
    size: int  # bytes
    _source: "XzReader"
    _left: int

    def chunks(self) -> Iterator[bytes]:
        """Yield the bytes of the file in chunks. Raises UsageError when the archive is truncated."""
        while self._left:
            piece = self._source.exactly(min(CHUNK, self._left))
            self._left -= len(piece)
            yield piece

    def skip(self) -> None:
        """Skip the rest of the file and its padding. Raises UsageError when the padding has data."""
        for _ in self.chunks():
            pass
        if self._source.exactly(-self.size % BLOCK).strip(b"\0"):
            raise UsageError(f"the archive is damaged: there is data after {self.name[:80]!r}")


class XzReader:
    """Decompresses an xz file on demand, with limits on memory and size."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._xz = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=MEMORY_MAX)
        self._in = self._out = 0

    def exactly(self, count: int) -> bytes:
        """Return the next `count` bytes. Raises UsageError when there are fewer, or when the archive is too large."""
        data = self.at_most(count)
        if len(data) != count:
            raise UsageError("the archive is cut off")
        return data

    def at_most(self, count: int) -> bytes:
        """Return the next `count` bytes, or fewer at the end. Raises UsageError for a damaged or too large archive."""
        chunks: list[bytes] = []
        missing = count
        while missing and not self._xz.eof:
            packed = b""
            if self._xz.needs_input:
                packed = self._file.read(CHUNK)
                self._in += len(packed)
                if not packed:
                    raise UsageError("the archive is cut off")
            try:
                chunks.append(self._xz.decompress(packed, missing))
            except lzma.LZMAError as wrong:
                raise UsageError(f"the archive cannot be unpacked: {str(wrong).lower()}") from None
            missing -= len(chunks[-1])
            self._out += len(chunks[-1])
            if self._out > TOTAL_MAX or (self._out > RATIO_FROM and self._out > RATIO_MAX * self._in):
                raise UsageError("the archive unpacks to more data than flights can have")
        return b"".join(chunks)

    def ends(self) -> bool:
        """Return whether the file ends here."""
        return self._xz.eof and not self._xz.unused_data and not self._file.read(1)


def read(file: BinaryIO) -> Iterator[ArchiveMember]:
    """Yield the files of an archive in their order, with unique names.

    Accepts only plain files in the ustar format: no links, devices or extended headers. Raises UsageError for other
    archives.
    """
    source, names = XzReader(file), set[str]()
    while True:
        header = source.exactly(BLOCK)
        if not header.strip(b"\0"):
            break
        packed = _packed(header, source)
        if packed.name in names:
            raise UsageError(f"the archive has {packed.name[:80]!r} twice")
        names.add(packed.name)
        yield packed
        packed.skip()
    while rest := source.at_most(CHUNK):
        if rest.strip(b"\0"):
            raise UsageError("the archive is damaged: there is data after its end")
    if not source.ends():
        raise UsageError("the archive is damaged: there is data after its end")


def write(path: Path, files: Iterable[tuple[str, Callable[[], bytes]]]) -> None:
    """Write an archive of files in this order. A file is (name, function that returns its bytes).

    Equal files give equal archives. Raises OSError.
    """
    with (
        lzma.open(path, "wb", format=lzma.FORMAT_XZ, preset=6) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name, made in files:
            data = made()
            entry = tarfile.TarInfo(name)  # without owner and time
            entry.size, entry.mode, entry.mtime = len(data), 0o644, 0
            tar.addfile(entry, BytesIO(data))


def _packed(header: bytes, source: XzReader) -> ArchiveMember:
    """Parse the header of a file (POSIX.1-1988, "ustar"). Raises UsageError for other headers."""
    sum_of = sum(header[:148]) + 8 * ord(" ") + sum(header[156:])
    if header[257:265] != b"ustar\x0000" or _octal(header[148:156]) != sum_of:
        raise UsageError("the archive is not a tar file of plain files")
    if header[156:157] != b"0":
        raise UsageError("the archive has a link or a folder; only plain files are allowed")
    name, prefix = (part.split(b"\0", 1)[0] for part in (header[:100], header[345:500]))
    try:
        path = (prefix + b"/" + name if prefix else name).decode("ascii")
    except UnicodeDecodeError:
        raise UsageError("the archive has a file that does not belong to a run") from None
    size = _octal(header[124:136])
    if size is None:
        raise UsageError(f"the archive is damaged: the size of {path[:80]!r} is not a number")
    return ArchiveMember(path, size, source, size)


def _octal(field: bytes) -> int | None:
    digits = field.rstrip(b" \0")
    return int(digits, 8) if digits and not digits.strip(b"01234567") else None


MANIFEST_MAX = 64 << 20  # largest manifest.json, bytes; LOG_MAX and FRAME_MAX: the same for one log, one frame
LOG_MAX = 256 << 20
LOGS_MAX = 4 << 30  # bytes of all logs together
FRAME_MAX = 32 << 20


def unpack(file: BinaryIO, place: Path) -> tuple[Manifest, list[str], int]:
    """Unpack the logs of an archive into a folder. Frames are only hashed.

    Returns the manifest, a sentence for each file whose digest differs from the manifest, and the number of frames.
    Accepts only the names of a run's files, and limited sizes. Raises UsageError for other archives, and OSError.
    """
    files = read(file)
    first = next(files, None)
    if first is None or first.name != MANIFEST or first.size > MANIFEST_MAX:
        raise UsageError(f"it is not an archive of `dronecats submit`: it does not begin with {MANIFEST}")
    manifest = decoded(b"".join(first.chunks()))
    _check_sizes(manifest)
    _check_names(manifest)
    differing: list[str] = []
    left, frames = dict(manifest.files), 0
    for packed in files:
        digest = left.pop(packed.name, None)
        if digest is None or digest.bytes != packed.size:
            raise UsageError(f"{packed.name[:80]!r} differs from its entry in {MANIFEST}")
        if LOG.fullmatch(packed.name):
            sha256 = _unpacked(packed, place / packed.name)
        else:
            sha256, frames = _hashed(packed), frames + 1
        if sha256 != digest.sha256:
            differing.append(f"{packed.name} has another digest than in {MANIFEST}")
    if left:
        raise UsageError(f"{next(iter(left))!r} is in its {MANIFEST} but not in the archive")
    return manifest, differing, frames


def _unpacked(packed: ArchiveMember, path: Path) -> str:
    """Write a file of an archive to a path, and return its SHA-256."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as out:
        return _hashed(packed, out.write)


def _hashed(packed: ArchiveMember, take: Callable[[bytes], object] = lambda chunk: None) -> str:
    sha256 = hashlib.sha256()
    for chunk in packed.chunks():
        sha256.update(chunk)
        take(chunk)
    return sha256.hexdigest()


def _check_sizes(manifest: Manifest) -> None:
    logs = 0
    for name, digest in manifest.files.items():
        most = FRAME_MAX if FRAME.fullmatch(name) else LOG_MAX
        logs += 0 if FRAME.fullmatch(name) else digest.bytes
        if digest.bytes > most or logs > LOGS_MAX:
            raise UsageError(f"{name!r} is too large")


def _check_names(manifest: Manifest) -> None:
    """Raise UsageError if a required file of the manifest's runs is missing, or if a file belongs to no run."""
    wanted = {f"{run.folder}/{layout.RUN}" for run in manifest.runs}
    homes = {f"{run.folder}/{episode}" for run in manifest.runs for episode in run.episodes}
    wanted |= {f"{home}/{log}" for home in homes for log in (layout.EPISODE, layout.DECISIONS, layout.TRUTH)}
    if len({run.folder for run in manifest.runs}) != len(manifest.runs) or not homes:
        raise UsageError(f"its {MANIFEST} names no run, or one run twice")
    if absent := next(iter(sorted(wanted - manifest.files.keys())), None):
        raise UsageError(f"{absent} is missing")
    for name in (*manifest.files, *manifest.left_out):
        home = "/".join(name.split("/")[:3])
        if name not in wanted and home not in homes:
            raise UsageError(f"{name!r} belongs to no run in its {MANIFEST}")
