"""A camera that gives one picture per HTTP request, simulated or real."""

import time
from collections.abc import Callable

import cv2

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError
from hil.cameras.http import Caller, body
from hil.cameras.lens import Lens
from hil.cameras.stream import decoded

PICTURE_BYTES_MAX = 64 * 1024 * 1024


class HttpCamera:
    """Each call fetches one picture.

    A simulated camera stamps it with the vehicle's clock. A real one's is stamped when its first bytes come: the time
    that it takes on the wire is no part of the picture.
    """

    def __init__(
        self,
        url: str,
        now_us: Callable[[], int],
        lens: Lens | None = None,
        *,
        max_age_s: float | None = None,
        timeout_s: float = 20.0,
    ) -> None:
        """A frame older than `max_age_s` on the vehicle's clock is an error. Raises UsageError."""
        self._caller = Caller(url)
        self.url = url
        self._now_us, self._lens = now_us, lens or Lens()
        self._max_age_s, self._timeout_s = max_age_s, timeout_s
        self._frames = 0
        self._none = f"the camera at {self._caller.name} gives no frame"
        self.stamps = False  # whether it stamped its newest picture itself
        self.reopened = 0  # a connection that breaks is an error at once: nothing is kept open

    @property
    def model(self) -> CameraModel:
        """The pinhole that the frames are pictures of. Takes one where that is not known yet. Raises CameraError."""
        if self._lens.model is None:
            self.newest()
        assert self._lens.model is not None  # a picture has come, and has said how large it is
        return self._lens.model

    @property
    def calibrated(self) -> bool:
        """Whether the lens is known: frames are straightened, and the field of view is measured."""
        return self._lens.calibration is not None

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError when none comes."""
        return self._frame(drone, {"drone": drone} if drone else None)

    def at(self, time_us: int, drone: int = 0) -> Frame:
        """Return a frame of a moment ago (µs, vehicle clock), which a simulated camera can give. Raises CameraError."""
        return self._frame(drone, {"drone": drone, "at": time_us})

    def _frame(self, drone: int, asked: dict[str, int] | None) -> Frame:
        try:
            response = self._caller.get(self._timeout_s, asked)
            if response.headers.get("content-type", "").startswith("multipart/"):
                response.close()
                raise CameraError("it sends a stream where a picture was asked for")
            came_s, data = body(response, PICTURE_BYTES_MAX)
        except CameraError as fault:
            raise CameraError(f"{self._none}: {fault}") from None
        picture = decoded(data)
        if picture is None:
            raise CameraError(f"{self._none}: what it sent is not a picture")
        arrived_us = self._now_us() - round((time.monotonic() - came_s) * 1e6)
        self.stamps = "X-Frame-Time-Us" in response.headers
        try:
            frame_id = int(response.headers.get("X-Frame-Id", self._frames))
            time_us = int(response.headers.get("X-Frame-Time-Us", arrived_us))
        except ValueError:
            raise CameraError(f"{self._none}: its X-Frame headers are not whole numbers") from None
        self._frames += 1
        age_s = (self._now_us() - time_us) / 1e6
        if self._max_age_s is not None and age_s > self._max_age_s:
            raise CameraError(f"{self._none}: the newest is {age_s:.1f} s old")
        straight = self._lens.straightened(picture)
        return Frame(frame_id, drone, time_us, cv2.cvtColor(straight, cv2.COLOR_BGR2RGB))

    def following(self, frame_id: int) -> Frame:
        """Return the next frame; asking is what makes one."""
        return self.newest()

    def close(self) -> None:
        self._caller.close()
