"""What a camera saw earlier, shown again at the pace at which it was taken."""

import threading
import time
from pathlib import Path
from typing import Any

import cv2

from foundation.errors import CameraError, UsageError
from hil.cameras.stream import Picture, StreamEndedError

ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".webp")
FOLDER_HZ = 10.0  # pictures per second of a folder, which does not say


class VideoSource:
    """A video file. Whoever is late for a picture gets the one whose time it is."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._capture: Any = None

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self._path, cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise CameraError("it is no video file that FFmpeg can read")
        self._rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or FOLDER_HZ
        self._began_s = time.monotonic()
        self._first_s: float | None = None

    def shoot(self, stop: threading.Event) -> tuple[float, Picture]:
        while True:
            if not self._capture.grab():
                raise StreamEndedError("the video is over")
            at_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            if self._first_s is None:
                self._first_s = at_s
            wait_s = self._began_s + at_s - self._first_s - time.monotonic()
            if wait_s > -1.0 / self._rate_hz:
                break
        stop.wait(max(0.0, wait_s))
        there, picture = self._capture.retrieve()
        if not there:
            raise StreamEndedError("the video breaks off")
        return time.monotonic(), picture

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()


class FolderSource:
    """The pictures of a folder in the order of their names."""

    def __init__(self, folder: str, rate_hz: float = FOLDER_HZ) -> None:
        self._folder, self._rate_hz = folder, rate_hz

    def open(self) -> None:
        self._paths = pictures(Path(self._folder))
        if not self._paths:
            raise CameraError(f"the folder holds no picture ({', '.join(ENDINGS)})")
        self._began_s, self._next = time.monotonic(), 0

    def shoot(self, stop: threading.Event) -> tuple[float, bytes]:
        now_s = time.monotonic()
        self._next = max(self._next, int((now_s - self._began_s) * self._rate_hz))
        if self._next >= len(self._paths):
            raise StreamEndedError("the pictures of the folder are over")
        stop.wait(max(0.0, self._began_s + self._next / self._rate_hz - now_s))
        path = self._paths[self._next]
        self._next += 1
        try:
            return time.monotonic(), path.read_bytes()
        except OSError as error:
            raise StreamEndedError(f"{path.name} cannot be read: {error.strerror}") from None

    def close(self) -> None:
        pass


def pictures(folder: Path) -> list[Path]:
    """Return the picture files of a folder, by name."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.is_file())


def rate_of(text: str | None) -> float:
    """Return the pictures per second that `?fps=` asks for. Raises UsageError."""
    try:
        rate_hz = FOLDER_HZ if text is None else float(text)
    except ValueError:
        rate_hz = 0.0
    if not 0.01 <= rate_hz <= 1000.0:
        raise UsageError(f"a folder's fps wants a number from 0.01 to 1000, not {text!r}")
    return rate_hz
