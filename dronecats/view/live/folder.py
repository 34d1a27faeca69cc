"""Reads a run folder while it is written: its flights, their worlds, log lines, MAVLink frames and pictures."""

import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from episodes.records import record as records
from episodes.world.world import World
from foundation import wire
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object

DEEP = 2  # an episode's folder is below its run's, and that below a benchmark's


@dataclass(frozen=True, slots=True)
class WatchedEpisode:
    """One flight."""

    name: str  # of its folder, from the folder that is watched
    folder: Path
    begun_ns: int  # ns of the machine's clock, when its folder was made ready
    over: bool  # it has been judged


class EpisodeList:
    """The flights below a folder, looked for again and again."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._over: dict[Path, WatchedEpisode] = {}  # what is over stays so

    def look(self) -> list[WatchedEpisode]:
        """Return the flights that there are, the newest first."""
        found = [self._over.get(folder) or self._episode(folder) for folder in _episodes(self._root, DEEP)]
        known = [one for one in found if one is not None]
        self._over = {one.folder: one for one in known if one.over}
        return sorted(known, key=lambda one: (-one.begun_ns, one.name))

    def _episode(self, folder: Path) -> WatchedEpisode | None:
        told = folder / layout.EPISODE
        try:
            begun_ns = told.stat().st_mtime_ns
        except OSError:
            return None  # not told yet: it is being made
        name = folder.name if folder == self._root else str(folder.relative_to(self._root))
        return WatchedEpisode(name, folder, begun_ns, (folder / layout.VERDICT).exists())


def newest_flown(episodes: list[WatchedEpisode]) -> WatchedEpisode | None:
    """Return the newest flight that is not over, None where there is none."""
    return next((one for one in episodes if not one.over), None)


def _episodes(folder: Path, deep: int) -> Iterator[Path]:
    if (folder / layout.DECISIONS).exists():
        yield folder
        return
    try:
        below = [entry for entry in os.scandir(folder) if deep and entry.is_dir() and entry.name != layout.UNFINISHED]
    except OSError:
        return
    for entry in below:
        yield from _episodes(Path(entry.path), deep - 1)


def flown_world(folder: Path) -> World | None:
    """Return the world of an episode folder; None where none is known: a real place, or a map that is not here."""
    drawn = folder / layout.WORLD  # of a flight on a map that is not judged
    try:
        return World(records.load(drawn if drawn.is_file() else folder / layout.EPISODE))
    except UsageError:
        return None


def is_told(folder: Path) -> bool:
    """Return whether an episode folder tells what is flown there; it is told before anything flies."""
    return json_object(folder / layout.EPISODE) is not None


def instruction_in(folder: Path) -> str:
    """Return what the pilots of an episode folder are told to do."""
    return str((json_object(folder / layout.EPISODE) or {}).get("instruction") or "")


def lens_in(folder: Path) -> CameraModel:
    """Return the camera of a flight: as run.json tells it, else the benchmark's. Where it sits is not told."""
    told = (json_object(folder.parent / layout.RUN) or {}).get("camera")
    if not isinstance(told, dict):
        return CameraModel()
    try:
        return CameraModel(int(told["width"]), int(told["height"]), float(told["hfov_deg"]))
    except (KeyError, TypeError, ValueError):
        return CameraModel()


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


NAME = re.compile(r"(\d{6,})(?:_d(\d+))?\.jpg")
END = b"\xff\xd9"  # of a JPEG that has been written to its end
KEPT = 4  # pictures of each drone
SETTLED_NS = 100_000_000  # a folder that has changed this lately may change once more without another time


class PictureTail:
    """The pictures of an episode; of each drone the newest are kept."""

    def __init__(self, folder: Path) -> None:
        """`folder` holds the pictures, as soon as it is there."""
        self._folder = folder
        self._seen_ns = -1  # when the folder had changed last
        self._newest: dict[int, int] = {}
        self._read: dict[tuple[int, int], bytes] = {}

    def newest(self, drone: int) -> tuple[int, bytes] | None:
        """Return (frame_id, JPEG) of a drone's newest picture that is whole, None where there is none."""
        self._look()
        frame_id = self._newest.get(drone)
        jpeg = None if frame_id is None else self.of(drone, frame_id)
        return None if frame_id is None or jpeg is None else (frame_id, jpeg)

    def of(self, drone: int, frame_id: int) -> bytes | None:
        """Return a picture, None where it is not there or not whole yet."""
        if (known := self._read.get((drone, frame_id))) is not None:
            return known
        try:
            jpeg = (self._folder / layout.frame_name(frame_id, drone)).read_bytes()
        except OSError:
            return None
        if not jpeg.endswith(END):
            return None
        mine = [key for key in self._read if key[0] == drone]
        if len(mine) >= KEPT:
            del self._read[mine[0]]
        self._read[drone, frame_id] = jpeg
        return jpeg

    def _look(self) -> None:
        """Look which pictures there are, if some have come."""
        try:
            changed_ns = self._folder.stat().st_mtime_ns
            if changed_ns == self._seen_ns:
                return
            names = [path.name for path in self._folder.iterdir()]
        except OSError:
            return
        self._seen_ns = changed_ns if time.time_ns() - changed_ns > SETTLED_NS else -1
        for name in names:
            if (found := NAME.fullmatch(name)) is not None:
                drone = int(found[2] or 0)
                self._newest[drone] = max(self._newest.get(drone, 0), int(found[1]))
