"""Opens any camera by its address. In flight, `PatientCamera` waits while no frame arrives."""

import time
from collections.abc import Callable

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError, UsageError
from hil.cameras.address import Address, parse, shown
from hil.cameras.http import Caller, HttpCamera, MjpegSource, is_multipart
from hil.cameras.lens import Calibration, Lens
from hil.cameras.stream import (
    MAX_AGE_S,
    PATIENCE_S,
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
ANSWER_S = 10.0  # s in which a camera must answer the first request


def open_camera(
    url: str, now_us: Callable[[], int], calibration: Calibration | None = None, *, max_age_s: float = MAX_AGE_S
) -> RealCamera:
    """Return the open camera at an address; its frames are stamped on the clock of `now_us`.

    With a calibration, the frames are corrected, and the camera's `model` follows from the calibration. Without one,
    HFOV_DEG is assumed. The camera raises CameraError instead of a frame older than `max_age_s`. Raises UsageError
    for an invalid address and a lens that cannot be corrected, CameraError if the camera cannot be opened. No error
    message contains the password of an address.
    """
    address = parse(url)
    lens = Lens(calibration)
    try:
        source = _source(address, lens)
        if source is None:
            return HttpCamera(url, now_us, lens, max_age_s=max_age_s, timeout_s=PATIENCE_S)
        return StreamCamera(source, shown(url), now_us, lens, max_age_s=max_age_s)
    except CameraError as fault:
        raise CameraError(f"the camera at {shown(url)} gives no frame: {fault}") from None


def _source(address: Address, lens: Lens) -> Source | None:
    """Return the source if the address sends pictures without requests; None: each picture needs a request."""
    allowed = {"v4l2": {"size"}, "folder": {"fps"}}.get(address.kind, set())
    if stray := set(address.options) - allowed:
        raise UsageError(f"camera option {sorted(stray)[0]!r} is not known for a {address.kind} camera")
    match address.kind:
        case "http":
            return _http_source(address.place)
        case "rtsp":
            return RtspSource(address.place)
        case "v4l2":
            model = lens.model or CameraModel()
            return V4l2Source(address.place, size_of(address.options.get("size")) or (model.width, model.height))
        case "folder":
            return FolderSource(address.place, rate_of(address.options.get("fps")))
        case _:
            return VideoSource(address.place)


def _http_source(url: str) -> MjpegSource | None:
    """Return the source of an MJPEG stream; None: the address sends one picture per request. Sends one request."""
    caller = Caller(url)
    response = caller.get(ANSWER_S)
    response.close()
    if is_multipart(response):
        return MjpegSource(caller)
    caller.close()
    return None


FRAMES_S = 10.0  # wall seconds without a fresh frame after which a flight ends
AGAIN_S = 0.1  # wall seconds between two attempts


class PatientCamera:
    """A camera that retries for up to `patience_s` wall seconds before it raises CameraError."""

    def __init__(self, camera: RealCamera, patience_s: float, on_stale: Callable[[str], None]) -> None:
        """`on_stale` is called once per wait for a frame, with the reason for the wait, on the caller's thread."""
        self._camera, self._patience_s, self._on_stale = camera, patience_s, on_stale

    @property
    def model(self) -> CameraModel:
        """The pinhole model of the frames. Raises CameraError."""
        return self._camera.model

    @property
    def stamps(self) -> bool:
        """Whether the newest picture has the camera's time stamp (vehicle's clock); if not, it has the arrival time."""
        return self._camera.stamps

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame that is not too old. Raises CameraError if there is none for `patience_s`."""
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
