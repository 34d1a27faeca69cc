"""A camera that sends by itself: a thread takes every picture off the wire, so that the newest is always at hand."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError
from hil.cameras.lens import Lens

Picture = NDArray[np.uint8]  # (H, W, 3), blue first, as OpenCV has it
MAX_AGE_S = 1.0  # s; what the drone saw longer ago says nothing about where it is
PATIENCE_S = 5.0  # s to wait for a picture that is young enough; the vehicle holds meanwhile
REOPEN_S = 0.5  # s between two attempts to get a broken stream back


class StreamEndedError(CameraError):
    """There will be no more pictures: a recording has come to its end."""


class Source(Protocol):
    """Where pictures come from. Used by one thread at a time."""

    def open(self) -> None:
        """Raises CameraError when nothing can be had."""
        ...

    def shoot(self, stop: threading.Event) -> tuple[float, bytes | Picture]:
        """Wait for the next picture; return the host's monotonic second at which it came, and the picture.

        `bytes` are an encoded picture. Raises CameraError when the stream broke, StreamEndedError when it ended.
        """
        ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture as it came off the wire."""

    number: int
    taken_s: float  # s, host's monotonic clock
    data: bytes | Picture


class StreamCamera:
    """Frames of one source, for one drone. What is older than `max_age_s` is an error and never a frame."""

    stamps = False  # none of these sources says when a picture was taken

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
        """`now_us` is the vehicle's clock; `name` the address as it may be shown. Raises CameraError."""
        self._source, self._now_us, self._lens = source, now_us, lens
        self._max_age_s, self._patience_s = max_age_s, patience_s
        self._none = f"the camera at {name} gives no frame"
        self._shot: Shot | None = None
        self._fault: str | None = None
        self._over = self._ended = False  # the thread reads no more; because the recording has come to its end
        self._news = threading.Condition()
        self._stop = threading.Event()
        self.reopened = 0  # how often the stream broke and came back
        source.open()
        self._thread = threading.Thread(target=self._read, name=f"camera {name}", daemon=True)
        self._thread.start()

    @property
    def model(self) -> CameraModel:
        """The pinhole that the frames are pictures of. Waits for the first one. Raises CameraError, UsageError."""
        if self._lens.model is None:
            self.newest()
        assert self._lens.model is not None  # a picture has come, and has said how large it is
        return self._lens.model

    @property
    def age_s(self) -> float | None:
        """Return how long ago (s) the newest picture came, None while there is none."""
        shot = self._shot
        return None if shot is None else time.monotonic() - shot.taken_s

    @property
    def calibrated(self) -> bool:
        """Whether the lens is known: frames are straightened, and the field of view is measured."""
        return self._lens.calibration is not None

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError when none that is young enough comes in time."""
        return self._frame(self._await(-1), drone)

    def following(self, frame_id: int) -> Frame:
        """Return the newest frame after `frame_id`, waiting for it. Raises CameraError."""
        return self._frame(self._await(frame_id), 0)

    def close(self) -> None:
        """Stop reading. The source is closed by the thread that reads it."""
        self._stop.set()
        self._thread.join(3.0)

    # -- what the caller waits for -----------------------------------------------------------------------------

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
        last = "none has come" if age_s is None else f"the last one is {age_s:.1f} s old"
        return f"{last}; {self._fault}" if self._fault else last

    def _frame(self, shot: Shot, drone: int) -> Frame:
        if drone:
            raise CameraError(f"{self._none} of drone {drone}: it is one drone's camera")
        picture = decoded(shot.data)
        if picture is None:
            raise CameraError(f"{self._none}: what it sent is not a picture")
        straight = self._lens.straightened(picture)
        time_us = self._now_us() - round((time.monotonic() - shot.taken_s) * 1e6)
        return Frame(shot.number, drone, time_us, cv2.cvtColor(straight, cv2.COLOR_BGR2RGB))

    # -- the thread that reads -----------------------------------------------------------------------------------

    def _read(self) -> None:
        number = 0
        try:
            while not self._stop.is_set():
                try:
                    taken_s, data = self._source.shoot(self._stop)
                except StreamEndedError as end:
                    self._ended = True
                    return self._tell(str(end), over=True)
                except CameraError as fault:
                    self._tell(str(fault))
                    self._reopen()
                    continue
                with self._news:
                    self._shot, self._fault = Shot(number, taken_s, data), None
                    self._news.notify_all()
                number += 1
        except Exception as bug:  # a thread that dies silently would look like a camera that hangs
            self._tell(f"reading it broke down with an unexpected {type(bug).__name__}", over=True)
        finally:
            self._source.close()

    def _reopen(self) -> None:
        self._source.close()
        while not self._stop.wait(REOPEN_S):
            try:
                self._source.open()
            except CameraError as fault:
                self._tell(str(fault))
            else:
                self.reopened += 1
                return

    def _tell(self, fault: str, *, over: bool = False) -> None:
        with self._news:
            self._fault, self._over = fault, over
            self._news.notify_all()


def decoded(data: bytes | Picture) -> Picture | None:
    """Return the picture, blue first; None when the bytes are none."""
    if not isinstance(data, bytes):
        return data
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
