"""Live video through OpenCV: RTSP, and cameras on this computer (Video4Linux)."""

import threading
import time
from typing import Any

import cv2

from foundation.errors import CameraError, UsageError
from hil.cameras.stream import Picture

OPEN_MS, READ_MS = 5000, 5000  # after which a silent stream is taken for absent, for broken
LIVE_GRABS = 3  # in a row that had to wait for their picture: nothing is kept any more
WAITED = 0.7  # of the time between two pictures; a computer that needs longer to decode one is too slow for the stream
DRAIN_S = 5.0


class RtspSource:
    """A camera in the network. FFmpeg reads it, over TCP: over UDP a lost packet is a smeared picture."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._capture: Any = None

    def open(self) -> None:
        # one decoding thread: with more, FFmpeg holds a picture back for each of them
        wanted = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS, cv2.CAP_PROP_N_THREADS, 1,
        ]  # fmt: skip
        self._capture = cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, wanted)
        if not self._capture.isOpened():
            raise CameraError("no video comes: nothing answers there, or the path, the user or the password is wrong")
        drain(self._capture)

    def shoot(self, stop: threading.Event) -> tuple[float, Picture]:
        return shoot(self._capture)

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()


class V4l2Source:
    """A camera on this computer, by USB or ribbon cable."""

    def __init__(self, device: str, size: tuple[int, int] | None) -> None:
        """`size` (width, height in px) is asked for; the camera gives the nearest that it has."""
        self._device, self._size = device, size
        self._capture: Any = None

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self._device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise CameraError("the device cannot be opened: it is absent, in use, or not yours to read (group video)")
        if self._size:
            # over USB large pictures come at full rate as JPEG only; a camera without it stays as it is
            self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def shoot(self, stop: threading.Event) -> tuple[float, Picture]:
        return shoot(self._capture)

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()


def shoot(capture: Any) -> tuple[float, Picture]:
    """Return the next picture of an open capture, with the host's monotonic second at which it was grabbed."""
    try:
        if not capture.grab():
            raise CameraError("its stream broke")
        taken_s = time.monotonic()
        there, picture = capture.retrieve()
    except cv2.error:
        raise CameraError("its stream broke") from None
    if not there:
        raise CameraError("its stream broke")
    return taken_s, picture


def drain(capture: Any) -> None:
    """Throw away what was kept: FFmpeg reads a second of a stream to learn what it is, and servers keep one, too.

    Handed out, that second would never be caught up with. A picture was kept when it comes sooner after the one before
    than it was taken.
    """
    live, at_ms, end_s = 0, capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic() + DRAIN_S
    while live < LIVE_GRABS and time.monotonic() < end_s:
        began_s = time.monotonic()
        shoot(capture)
        waited_ms, before_ms = (time.monotonic() - began_s) * 1e3, at_ms
        at_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
        live = live + 1 if waited_ms > max(2.0, WAITED * (at_ms - before_ms)) else 0


def size_of(text: str | None) -> tuple[int, int] | None:
    """Return (width, height) of '1280x720'; None of None. Raises UsageError."""
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if width.isdigit() and height.isdigit() and 0 < int(width) < 20000 and 0 < int(height) < 20000:
        return int(width), int(height)
    raise UsageError(f"a camera's size reads WIDTHxHEIGHT, for example v4l2:0?size=1280x720, not {text!r}")
