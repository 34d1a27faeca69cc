"""A camera behind an HTTP snapshot address, simulated or real."""

from collections.abc import Callable

import cv2
import httpx
import numpy as np

from dronecats.border.camera import Frame
from dronecats.border.errors import CameraError
from dronecats.border.redaction import redacted


class HttpCamera:
    """Each call fetches one picture. A simulated camera stamps it; a real one's is stamped with `now_us` on arrival."""

    def __init__(self, url: str, now_us: Callable[[], int], timeout_s: float = 20.0) -> None:
        self.url = url
        self._now_us = now_us
        self._frames = 0
        self._none = f"the camera at {redacted(url)} gives no frame"
        self._http = httpx.Client(timeout=httpx.Timeout(timeout_s, connect=5.0))

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError when none comes."""
        try:
            response = self._http.get(self.url, params={"drone": drone} if drone else None)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise CameraError(f"{self._none}: {redacted(str(error)) or type(error).__name__}") from None
        if response.status_code != 200:
            said = " ".join(response.text[:120].split())
            raise CameraError(f"{self._none}: it answered {response.status_code} {said}")
        data = np.frombuffer(response.content, np.uint8)
        picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        if picture is None:
            raise CameraError(f"{self._none}: what it sent is not a picture")
        try:
            frame_id = int(response.headers.get("X-Frame-Id", self._frames))
            time_us = int(response.headers.get("X-Frame-Time-Us", self._now_us()))
        except ValueError:
            raise CameraError(f"{self._none}: its X-Frame headers are not whole numbers") from None
        self._frames += 1
        return Frame(frame_id, drone, time_us, cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))

    def close(self) -> None:
        self._http.close()
