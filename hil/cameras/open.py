"""Opens any camera by its address, and waits out the gaps of one that flies."""

import time
from collections.abc import Callable

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError, UsageError
from hil.cameras.address import Address, parse, shown
from hil.cameras.http import Caller, HttpCamera, MjpegSource
from hil.cameras.lens import HFOV_DEG, Calibration, Lens
from hil.cameras.stream import (
    MAX_AGE_S,
    FolderSource,
    RtspSource,
    Source,
    StreamCamera,
    V4l2Source,
    VideoSource,
    rate_of,
    size_of,
)

RealCamera = HttpCamera | StreamCamera
ANSWER_S = 10.0  # s that a camera may take for its first picture


def open_camera(
    url: str,
    now_us: Callable[[], int],
    calibration: Calibration | None = None,
    *,
    hfov_deg: float = HFOV_DEG,
    max_age_s: float = MAX_AGE_S,
) -> RealCamera:
    """Return the camera at an address, open, its frames stamped on the clock that `now_us` reads.

    With a calibration its frames are straightened and `model` is what the calibration says; without one `hfov_deg` is
    believed. A frame older than `max_age_s` is a CameraError. Raises UsageError for an address that is none and a lens
    that cannot be undone, CameraError when nothing comes. No password of an address is ever in an error.
    """
    address = parse(url)
    lens = Lens(calibration, hfov_deg)
    try:
        source = _source(address, lens)
        if source is None:
            return HttpCamera(url, now_us, lens, max_age_s=max_age_s)
        return StreamCamera(source, shown(url), now_us, lens, max_age_s=max_age_s)
    except CameraError as fault:
        raise CameraError(f"the camera at {shown(url)} gives no frame: {fault}") from None


def _source(address: Address, lens: Lens) -> Source | None:
    """Return the source that sends pictures by itself at an address; None for one that needs a request for each."""
    allowed = {"v4l2": {"size"}, "folder": {"fps"}}.get(address.kind, set())
    if stray := set(address.options) - allowed:
        raise UsageError(f"camera option {sorted(stray)[0]!r} is not known for a {address.kind} camera")
    match address.kind:
        case "http":
            return _http_source(address.place)
        case "rtsp":
            return RtspSource(address.place)
        case "v4l2":
            size = size_of(address.options.get("size"))
            if size is None and lens.model:
                size = (lens.model.width, lens.model.height)
            return V4l2Source(address.place, size)
        case "folder":
            return FolderSource(address.place, rate_of(address.options.get("fps")))
        case _:
            return VideoSource(address.place)


def _http_source(url: str) -> MjpegSource | None:
    """Ask once: the type of the answer says which of the two it is."""
    caller = Caller(url)
    response = caller.get(ANSWER_S)
    response.close()
    if response.headers.get("content-type", "").startswith("multipart/"):
        return MjpegSource(caller)
    caller.close()
    return None


FRAMES_S = 10.0  # wall seconds without a fresh frame after which a flight ends
AGAIN_S = 0.1  # wall seconds between two attempts


class PatientCamera:
    """Asks again for up to `patience_s` wall seconds before it lets a camera's fault through."""

    def __init__(self, camera: RealCamera, patience_s: float, on_stale: Callable[[str], None]) -> None:
        """`on_stale` hears, once for every gap, why no frame can be used; from the thread that asks."""
        self._camera, self._patience_s, self._on_stale = camera, patience_s, on_stale

    @property
    def model(self) -> CameraModel:
        """The pinhole that the frames are pictures of. Raises CameraError."""
        return self._camera.model

    @property
    def stamps(self) -> bool:
        """Whether it stamped its newest picture itself, with the vehicle's clock; else that is when it arrived."""
        return self._camera.stamps

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame that is young enough. Raises CameraError when none has come for too long."""
        began_s, has_warned = time.monotonic(), False
        while True:
            try:
                return self._camera.newest(drone)
            except CameraError as fault:
                if time.monotonic() - began_s > self._patience_s:
                    raise
                if not has_warned:
                    has_warned = True
                    self._on_stale(str(fault))
                time.sleep(AGAIN_S)

    def close(self) -> None:
        self._camera.close()
