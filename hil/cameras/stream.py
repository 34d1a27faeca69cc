"""Sources that deliver pictures without requests (RTSP, V4L2, video files, folders), and a camera for one of them."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError, UsageError
from hil.cameras.lens import Lens

Picture = NDArray[np.uint8]  # (H, W, 3), BGR as in OpenCV
MAX_AGE_S = 1.0  # s; an older picture is not used, because the vehicle may be elsewhere by now
PATIENCE_S = 5.0  # s to wait for a picture that is not too old; the vehicle holds meanwhile
REOPEN_S = 0.5  # s between two attempts to reopen a broken stream


class StreamEndedError(CameraError):
    """Raised if there are no more pictures, because a recording has ended."""


class Source(Protocol):
    """A source of pictures. One thread uses it at a time."""

    def open(self) -> None:
        """Open the source. Raises CameraError if that fails."""
        ...

    def shoot(self, stop: threading.Event) -> tuple[float, bytes | Picture]:
        """Wait for the next picture; return its time of arrival (s, the host's monotonic clock), and the picture.

        `bytes` are an encoded picture. Raises CameraError if the stream breaks, StreamEndedError if it ends.
        """
        ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture with its time of arrival."""

    number: int
    taken_s: float  # s, host's monotonic clock
    data: bytes | Picture


class LensCamera:
    """A camera with a lens. Subclasses deliver the frames."""

    def __init__(self, lens: Lens) -> None:
        self._lens = lens

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError if none arrives."""
        raise NotImplementedError

    @property
    def model(self) -> CameraModel:
        """The pinhole model of the frames. Waits for a frame if the model is not known yet. Raises CameraError."""
        if self._lens.model is None:
            self.newest()
        assert self._lens.model is not None  # a picture has arrived, so its size is known
        return self._lens.model

    @property
    def calibrated(self) -> bool:
        """Whether the lens is known: frames are straightened, and the field of view is measured."""
        return self._lens.calibration is not None


class StreamCamera(LensCamera):
    """A camera that reads one source, for one drone. It gives no picture that is older than `max_age_s`."""

    stamps = False  # streams carry no time stamps, so pictures are stamped at their arrival

    def __init__(
        self,
        source: Source,
        name: str,
        now_us: Callable[[], int],
        lens: Lens,
        *,
        max_age_s: float = MAX_AGE_S,
        patience_s: float = PATIENCE_S,
    ) -> None:
        """`now_us` is the vehicle's clock; `name` is the camera's address as messages show it. Raises CameraError."""
        super().__init__(lens)
        self._source, self._now_us = source, now_us
        self._max_age_s, self._patience_s = max_age_s, patience_s
        self._none = f"the camera at {name} gives no frame"
        self._shot: Shot | None = None
        self._fault: str | None = None
        self._over = self._ended = False  # whether the thread has stopped; whether it stopped because a recording ended
        self._news = threading.Condition()
        self._stop = threading.Event()
        self.reopened = 0  # number of reopenings
        source.open()
        self._thread = threading.Thread(target=self._read, name=f"camera {name}", daemon=True)
        self._thread.start()

    @property
    def age_s(self) -> float | None:
        """Age (s) of the newest picture; None: there is none yet."""
        shot = self._shot
        return None if shot is None else time.monotonic() - shot.taken_s

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError if no recent one arrives in time."""
        return self._frame(self._await(-1), drone)

    def following(self, frame_id: int) -> Frame:
        """Return the newest frame after `frame_id`, waiting for it. Raises CameraError."""
        return self._frame(self._await(frame_id), 0)

    def close(self) -> None:
        """Stop reading. The source is closed by the thread that reads it."""
        self._stop.set()
        self._thread.join(3.0)

    # -- the caller's thread -----------------------------------------------------------------------------------

    def _young(self, after: int) -> Shot | None:
        shot = self._shot
        if shot is None or shot.number <= after or time.monotonic() - shot.taken_s > self._max_age_s:
            return None
        return shot

    def _await(self, after: int) -> Shot:
        with self._news:
            self._news.wait_for(lambda: self._young(after) or self._over, self._patience_s)
            shot = self._young(after)
            if shot is None:
                raise (StreamEndedError if self._ended else CameraError)(f"{self._none}: {self._why()}")
            return shot

    def _why(self) -> str:
        age_s = self.age_s
        last = "none has arrived" if age_s is None else f"the last one is {age_s:.1f} s old"
        return f"{last}; {self._fault}" if self._fault else last

    def _frame(self, shot: Shot, drone: int) -> Frame:
        if drone:
            raise CameraError(f"{self._none} of drone {drone + 1}: it is the camera of one drone")
        picture = decoded(shot.data)
        if picture is None:
            raise CameraError(f"{self._none}: it sent something that is not a picture")
        straight = self._lens.straightened(picture)
        time_us = self._now_us() - round((time.monotonic() - shot.taken_s) * 1e6)
        return Frame(shot.number, drone, time_us, cv2.cvtColor(straight, cv2.COLOR_BGR2RGB))

    # -- the reading thread --------------------------------------------------------------------------------------

    def _read(self) -> None:
        number = 0
        try:
            while not self._stop.is_set():
                try:
                    taken_s, data = self._source.shoot(self._stop)
                except StreamEndedError as end:
                    self._ended = True
                    return self._set_fault(str(end), over=True)
                except CameraError as fault:
                    self._set_fault(str(fault))
                    self._reopen()
                    continue
                with self._news:
                    self._shot, self._fault = Shot(number, taken_s, data), None
                    self._news.notify_all()
                number += 1
        except Exception as bug:  # without this, a dead thread would look like a hanging camera
            self._set_fault(f"reading it broke down with an unexpected {type(bug).__name__}", over=True)
        finally:
            self._source.close()

    def _reopen(self) -> None:
        self._source.close()
        while not self._stop.wait(REOPEN_S):
            try:
                self._source.open()
            except CameraError as fault:
                self._set_fault(str(fault))
            else:
                self.reopened += 1
                return

    def _set_fault(self, fault: str, *, over: bool = False) -> None:
        with self._news:
            self._fault, self._over = fault, over
            self._news.notify_all()


def decoded(data: bytes | Picture) -> Picture | None:
    """Return the picture (BGR); None: the bytes are not a picture."""
    if not isinstance(data, bytes):
        return data
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    except cv2.error:  # the header has an impossible size
        return None


OPEN_MS, READ_MS = 5000, 5000  # ms of silence until opening a stream fails, or until an open stream counts as broken
LIVE_GRABS = 3  # after so many grabs (fetches of a picture) in a row that had to wait, the buffer counts as empty
WAITED = 0.7  # a grab had to wait if it took longer than this share of the time between two pictures
DRAIN_S = 5.0  # longest time to spend on dropping buffered pictures


class CaptureSource:
    """A source that OpenCV reads. Subclasses open `_capture`."""

    _capture: Any = None

    def shoot(self, stop: threading.Event) -> tuple[float, Picture]:
        return shoot(self._capture)

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()


class RtspSource(CaptureSource):
    """A camera in the network. FFmpeg reads it over TCP, because a lost UDP packet would damage a picture."""

    def __init__(self, url: str) -> None:
        self._url = url

    def open(self) -> None:
        # one decoding thread, because each thread of FFmpeg delays the video by one picture
        wanted = [
            cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS, cv2.CAP_PROP_N_THREADS, 1,
        ]  # fmt: skip
        self._capture = cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, wanted)
        if not self._capture.isOpened():
            raise CameraError("no video arrives. Check the server, the path, the user and the password")
        drain(self._capture)


class V4l2Source(CaptureSource):
    """A camera on this computer, by USB or ribbon cable."""

    def __init__(self, device: str, size: tuple[int, int]) -> None:
        """`size` (width, height in px) is requested; the camera uses the nearest size that it has."""
        self._device, self._size = device, size

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self._device, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            raise CameraError(
                "the device cannot be opened: it does not exist, is in use, or this user is not in the group video"
            )
        # over USB, large pictures reach their full rate only as JPEG; a camera without JPEG keeps its format
        self._capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)


def shoot(capture: Any) -> tuple[float, Picture]:
    """Return the next picture of an open capture and the time (s, the host's monotonic clock) of its grab."""
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
    """Drop the buffered pictures. Otherwise every later picture would be seconds old.

    FFmpeg buffers a second of a stream to find its format, and servers buffer about a second too. If a grab takes
    clearly less time than the interval between the stamps of two pictures, the picture came from a buffer.
    """
    live, at_ms, end_s = 0, capture.get(cv2.CAP_PROP_POS_MSEC), time.monotonic() + DRAIN_S
    while live < LIVE_GRABS and time.monotonic() < end_s:
        began_s = time.monotonic()
        shoot(capture)
        waited_ms, before_ms = (time.monotonic() - began_s) * 1e3, at_ms
        at_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
        live = live + 1 if waited_ms > max(2.0, WAITED * (at_ms - before_ms)) else 0


def size_of(text: str | None) -> tuple[int, int] | None:
    """Return (width, height) of '1280x720'; None for None. Raises UsageError."""
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if width.isdigit() and height.isdigit() and 0 < int(width) < 20000 and 0 < int(height) < 20000:
        return int(width), int(height)
    raise UsageError(f"a camera's size must be WIDTHxHEIGHT, for example v4l2:0?size=1280x720; got {text!r}")


ENDINGS = (".jpg", ".jpeg", ".png", ".bmp", ".webp")
FOLDER_HZ = 10.0  # pictures per second of a folder without ?fps=


class VideoSource(CaptureSource):
    """A video file, played in real time. Pictures whose time has passed are skipped."""

    def __init__(self, path: str) -> None:
        self._path = path

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self._path, cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise CameraError("FFmpeg cannot read it as a video file")
        self._rate_hz = self._capture.get(cv2.CAP_PROP_FPS) or FOLDER_HZ
        self._began_s = time.monotonic()
        self._first_s: float | None = None

    def shoot(self, stop: threading.Event) -> tuple[float, Picture]:
        while True:
            if not self._capture.grab():
                raise StreamEndedError("the video has ended")
            at_s = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            if self._first_s is None:
                self._first_s = at_s
            wait_s = self._began_s + at_s - self._first_s - time.monotonic()
            if wait_s > -1.0 / self._rate_hz:
                break
        stop.wait(max(0.0, wait_s))
        there, picture = self._capture.retrieve()
        if not there:
            raise StreamEndedError("the video is damaged")
        return time.monotonic(), picture


class FolderSource:
    """The pictures of a folder in the order of their names, `rate_hz` per second."""

    def __init__(self, folder: str, rate_hz: float = FOLDER_HZ) -> None:
        self._folder, self._rate_hz = folder, rate_hz

    def open(self) -> None:
        self._paths = pictures(Path(self._folder))
        if not self._paths:
            raise CameraError(f"the folder has no picture ({', '.join(ENDINGS)})")
        self._began_s: float | None = None  # host's clock when the first picture was due
        self._next = 0

    def shoot(self, stop: threading.Event) -> tuple[float, bytes]:
        now_s = time.monotonic()
        self._began_s = now_s if self._began_s is None else self._began_s
        self._next = max(self._next, int((now_s - self._began_s) * self._rate_hz))
        if self._next >= len(self._paths):
            raise StreamEndedError("the last picture of the folder was sent")
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
    """Return the pictures per second of `?fps=`. Raises UsageError."""
    try:
        rate_hz = FOLDER_HZ if text is None else float(text)
    except ValueError:
        rate_hz = 0.0
    if not 0.01 <= rate_hz <= 1000.0:
        raise UsageError(f"a folder's fps must be 0.01 to 1000, got {text!r}")
    return rate_hz
