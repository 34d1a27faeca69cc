"""Reads a run folder while it is written: flights and their worlds, log lines, MAVLink frames and pictures.

No function blocks or locks a file, so the reader does not affect the writer. A missing file counts as empty.
"""

import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dronecats.report.recorded.run import RecordedRun
from episodes.records import record as records
from episodes.world.world import World
from foundation import wire
from foundation.camera import CameraModel
from foundation.errors import UsageError
from foundation.run_folder import layout
from foundation.run_folder.reading import json_object

DEPTH = 2  # levels of subfolders that are searched: benchmark / run / episode
READ_BYTES = 4_000_000  # one read returns at most this many bytes; the next reads return the rest of a long log
NAME = re.compile(r"(\d{6,})(?:_d(\d+))?\.jpg")
END = b"\xff\xd9"  # last bytes of a complete JPEG
KEPT = 4  # the cache has at most this many pictures per drone
SETTLED_NS = 100_000_000  # a folder that changed more recently is listed again: a new file may not change its time


@dataclass(frozen=True, slots=True)
class WatchedEpisode:
    """One flight below the watched folder."""

    name: str  # name of the flight's folder, relative to the watched folder
    folder: Path
    begun_ns: int  # ns, system clock, when the flight's folder was prepared
    over: bool  # whether the flight has been judged


class EpisodeList:
    def __init__(self, root: Path) -> None:
        self._root = root
        self._over: dict[Path, WatchedEpisode] = {}

    def look(self) -> list[WatchedEpisode]:
        """Return the current flights, newest first."""
        folders = _episode_folders(self._root, DEPTH)
        episodes = [e for folder in folders if (e := self._episode(folder)) is not None]
        self._over = {episode.folder: episode for episode in episodes if episode.over}
        return sorted(episodes, key=lambda episode: (-episode.begun_ns, episode.name))

    def _episode(self, folder: Path) -> WatchedEpisode | None:
        try:
            begun_ns = (folder / layout.EPISODE).stat().st_mtime_ns
        except OSError:
            return None  # the folder is being prepared
        former = self._over.get(folder)
        if former is not None and former.begun_ns == begun_ns:  # otherwise the episode was flown again in this folder
            return former
        name = folder.name if folder == self._root else str(folder.relative_to(self._root))
        return WatchedEpisode(name, folder, begun_ns, (folder / layout.VERDICT).exists())


def _episode_folders(folder: Path, depth: int) -> Iterator[Path]:
    if (folder / layout.DECISIONS).exists():
        yield folder
        return
    try:
        below = [entry for entry in os.scandir(folder) if depth and entry.is_dir() and entry.name != layout.UNFINISHED]
    except OSError:
        return
    for entry in below:
        yield from _episode_folders(Path(entry.path), depth - 1)


def load_world(folder: Path) -> World | None:
    """Return the world of an episode folder; None for a flight in the real world, or if the map is not installed."""
    drawn = folder / layout.WORLD  # the record that was rendered; only flights without a judge have it
    try:
        record = records.load(drawn if drawn.is_file() else folder / layout.EPISODE)
        return World(record, conditions=_run(folder).conditions)
    except UsageError:
        return None


def load_camera(folder: Path) -> CameraModel:
    """Return the camera in a flight's run.json, or the benchmark's camera if there is none."""
    return _run(folder).camera


def _run(folder: Path) -> RecordedRun:
    """Return the run of an episode folder: settings only, no episodes. The run may still be in progress."""
    configuration = json_object(folder.parent / layout.RUN) or {}
    return RecordedRun(folder=folder.parent, configuration=configuration, episodes=())


class GrowingFile:
    """A file that is read as it grows."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0

    def read(self) -> bytes:
        """Return the new bytes, READ_BYTES at most; empty if the file cannot be read."""
        try:
            if self._path.stat().st_size <= self._at:
                return b""
            with self._path.open("rb") as file:
                file.seek(self._at)
                data = file.read(READ_BYTES)
        except OSError:
            return b""
        self._at += len(data)
        return data


class LineTail:
    def __init__(self, path: Path) -> None:
        self._file, self._rest = GrowingFile(path), b""

    def read(self) -> list[bytes]:
        """Return the lines completed since the last call, without line ends."""
        data = self._file.read()
        if not data:
            return []
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


class FrameTail:
    """The MAVLink frames of a growing tlog."""

    def __init__(self, path: Path) -> None:
        self._file, self._rest = GrowingFile(path), b""

    def read(self) -> list[tuple[int, bytes]]:
        """Return (vehicle time in µs, MAVLink 2 frame) of the frames completed since the last call."""
        data = self._rest + self._file.read()
        frames, rest = wire.logged_frames(data)
        self._rest = data[rest:]
        return [(time_us, frame) for time_us, frame in frames if frame[0] == wire.MARKER]


def is_intact(frame: bytes) -> bool:
    """Return whether a MAVLink 2 frame is undamaged and has a known message."""
    return wire.scan(frame)[0] == [frame]


class PictureTail:
    """Reads the pictures of an episode, and caches the last ones of each drone."""

    def __init__(self, folder: Path) -> None:
        """`folder` is the folder of the pictures. It need not exist yet."""
        self._folder = folder
        self._seen_ns = -1  # ns, modification time of the folder when it was last listed; -1: list it again
        self._newest: dict[int, int] = {}  # drone → newest frame id
        self._read: dict[tuple[int, int], bytes] = {}  # (drone, frame id) → JPEG

    def newest(self, drone: int) -> tuple[int, bytes] | None:
        """Return (frame_id, JPEG) of a drone's newest picture; None if it is missing or incomplete."""
        self._look()
        frame_id = self._newest.get(drone)
        jpeg = None if frame_id is None else self.of(drone, frame_id)
        return None if frame_id is None or jpeg is None else (frame_id, jpeg)

    def of(self, drone: int, frame_id: int) -> bytes | None:
        """Return a picture; None if it is missing or incomplete."""
        if (jpeg := self._read.get((drone, frame_id))) is not None:
            return jpeg
        try:
            jpeg = (self._folder / layout.frame_name(frame_id, drone)).read_bytes()
        except OSError:
            return None
        if not jpeg.endswith(END):
            return None
        kept = [key for key in self._read if key[0] == drone]
        if len(kept) >= KEPT:
            del self._read[kept[0]]
        self._read[drone, frame_id] = jpeg
        return jpeg

    def _look(self) -> None:
        try:
            changed_ns = self._folder.stat().st_mtime_ns
            if changed_ns == self._seen_ns:
                return
            names = [path.name for path in self._folder.iterdir()]
        except OSError:
            return
        self._seen_ns = changed_ns if time.time_ns() - changed_ns > SETTLED_NS else -1
        for name in names:
            if (match := NAME.fullmatch(name)) is not None:
                drone = int(match[2] or 0)
                self._newest[drone] = max(self._newest.get(drone, 0), int(match[1]))
