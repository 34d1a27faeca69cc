"""A camera whose gaps are waited out: no decision is made on an old frame, and the vehicle holds meanwhile."""

import time
from collections.abc import Callable

from foundation.camera import CameraModel, Frame
from foundation.errors import CameraError
from hil.cameras.open import RealCamera

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
        began_s, told = time.monotonic(), False
        while True:
            try:
                return self._camera.newest(drone)
            except CameraError as fault:
                if time.monotonic() - began_s > self._patience_s:
                    raise
                if not told:
                    told = True
                    self._on_stale(str(fault))
                time.sleep(AGAIN_S)

    def close(self) -> None:
        self._camera.close()
