"""Cameras over HTTP: one picture per request, or Motion JPEG. No message shows the password."""

import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from email.message import Message

import cv2
import httpx
import numpy as np
from numpy.typing import NDArray

from foundation.camera import Frame, decode_depth
from foundation.errors import CameraError, UsageError
from foundation.machine import is_host
from hil.cameras.address import shown
from hil.cameras.lens import Lens
from hil.cameras.stream import LensCamera, Picture, decoded

CONNECT_S = 5.0
ERROR_NUMBER = re.compile(r"^\[Errno -?\d+\] ")


class Caller:
    """An HTTP client for the address of one camera. The connection stays open between requests."""

    def __init__(self, url: str) -> None:
        """Raises UsageError for an invalid address."""
        self.name = shown(url)
        try:
            self._url = httpx.URL(url)
        except httpx.InvalidURL:
            self._url = httpx.URL("")
        if not is_host(self._url.host):
            raise UsageError(
                f"camera {self.name!r} is not an http address. Write special characters of a password as %XX, for"
                " example %40 for @"
            )
        self._auth: httpx.Auth | None = None  # None: basic authentication with the address's user and password
        # no internet proxy, because a camera is in the local network
        self._http = httpx.Client(trust_env=False)

    def get(self, read_s: float, params: dict[str, int] | None = None) -> httpx.Response:
        """Return the response with an unread body; the caller must close it. Raises CameraError.

        `read_s`: s of silence after which the camera counts as broken.
        """
        response = self._send(read_s, params)
        challenge = response.headers.get("www-authenticate", "").lower()
        if response.status_code == 401 and challenge.startswith("digest") and self._auth is None and self._url.username:
            response.close()
            self._auth = httpx.DigestAuth(self._url.username, self._url.password)
            response = self._send(read_s, params)
        if response.status_code != 200:
            try:
                text = " ".join(response.read()[:120].decode("utf-8", "replace").split())
            except httpx.HTTPError:
                text = ""
            finally:
                response.close()
            raise CameraError(f"it answered {response.status_code} {text}".rstrip())
        return response

    def _send(self, read_s: float, params: dict[str, int] | None) -> httpx.Response:
        url = self._url.copy_merge_params(params) if params else self._url  # `params=` would drop the address's query
        request = self._http.build_request("GET", url, timeout=httpx.Timeout(read_s, connect=CONNECT_S))
        try:
            return self._http.send(request, stream=True, auth=self._auth or httpx.USE_CLIENT_DEFAULT)
        except httpx.HTTPError as error:
            reason = ERROR_NUMBER.sub("", shown(str(error))) or type(error).__name__
            raise CameraError(f"{reason}. Check the address and the camera") from None

    def close(self) -> None:
        self._http.close()


def body(response: httpx.Response, bytes_max: int) -> tuple[float, bytes]:
    """Return the arrival (s, the host's monotonic clock) of the first bytes of the body, and the body.

    Raises CameraError if the connection breaks, or the body is larger than `bytes_max`.
    """
    chunks: list[bytes] = []
    began_s, size = time.monotonic(), 0
    try:
        for chunk in response.iter_bytes():
            if not chunks:
                began_s = time.monotonic()
            chunks.append(chunk)
            size += len(chunk)
            if size > bytes_max:
                raise CameraError("it sent more data than a picture can have")
    except httpx.HTTPError as error:
        raise CameraError(f"the connection broke: {type(error).__name__}") from None
    finally:
        response.close()
    return began_s, b"".join(chunks)


PICTURE_BYTES_MAX = 64 * 1024 * 1024


class HttpCamera(LensCamera):
    """A camera over HTTP: each call fetches one picture.

    A simulated camera stamps its pictures with the vehicle's clock. A real camera's picture is stamped when its first
    bytes arrive, so the duration of the transfer does not count.
    """

    def __init__(
        self,
        url: str,
        now_us: Callable[[], int],
        lens: Lens | None = None,
        *,
        max_age_s: float | None = None,
        timeout_s: float = 20.0,
        depth_url: str | None = None,
    ) -> None:
        """A frame older than `max_age_s` on the vehicle's clock is an error. Raises UsageError for an invalid address.

        `depth_url`: where a simulated camera serves the depth pictures of its frames; None: frames have no depth.
        """
        self._caller = Caller(url)
        self._depths = Caller(depth_url) if depth_url else None
        self.url = url
        super().__init__(lens or Lens())
        self._now_us = now_us
        self._max_age_s, self._timeout_s = max_age_s, timeout_s
        self._frames = 0
        self._none = f"the camera at {self._caller.name} gives no frame"
        self.stamps = False  # whether the newest picture came with a time stamp of the camera
        self.reopened = 0  # always 0: there is no stream to reopen

    def newest(self, drone: int = 0) -> Frame:
        """Return the newest frame. Raises CameraError if none arrives."""
        return self._frame(drone, {"drone": drone} if drone else None)

    def at(self, time_us: int, drone: int = 0) -> Frame:
        """Return the frame of an earlier time (µs, vehicle clock); only for a simulated camera. Raises CameraError."""
        return self._frame(drone, {"drone": drone, "at": time_us})

    def _frame(self, drone: int, params: dict[str, int] | None) -> Frame:
        if self._depths:
            params = {**(params or {}), "depth": 1}
        try:
            response = self._caller.get(self._timeout_s, params)
            if is_multipart(response):
                response.close()
                raise CameraError("it sends a stream instead of a picture")
            came_s, data = body(response, PICTURE_BYTES_MAX)
        except CameraError as fault:
            raise CameraError(f"{self._none}: {fault}") from None
        picture = decoded(data)
        if picture is None:
            raise CameraError(f"{self._none}: it sent something that is not a picture")
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
        return Frame(frame_id, drone, time_us, cv2.cvtColor(straight, cv2.COLOR_BGR2RGB), self._depth_of(frame_id))

    def _depth_of(self, frame_id: int) -> NDArray[np.uint16] | None:
        """Return the depth picture of a frame; None if the camera serves none. Raises CameraError."""
        if self._depths is None:
            return None
        try:
            _, data = body(self._depths.get(self._timeout_s, {"frame": frame_id}), PICTURE_BYTES_MAX)
        except CameraError as fault:
            raise CameraError(f"{self._none}: {fault}") from None
        depth_mm = decode_depth(data)
        if depth_mm is None:
            raise CameraError(f"{self._none}: it sent something that is not a depth picture")
        return depth_mm

    def following(self, frame_id: int) -> Frame:
        """Return the next frame; `frame_id` is not used, because each request gets a new picture."""
        return self.newest()

    def close(self) -> None:
        self._caller.close()
        if self._depths:
            self._depths.close()


PART_BYTES_MAX = 32 * 1024 * 1024
SILENCE_S = 2.0  # s without a byte until the stream counts as broken


def is_multipart(response: httpx.Response) -> bool:
    """Return whether a response is a stream of pictures."""
    return bool(response.headers.get("content-type", "").lower().startswith("multipart/"))


class Multipart:
    """Splits the bytes of a multipart response into its parts."""

    def __init__(self, content_type: str) -> None:
        """Raises CameraError if the header has no boundary."""
        header = Message()
        header["Content-Type"] = content_type
        boundary = str(header.get_param("boundary", "")).strip()
        # some cameras write the two leading dashes into the header, others do not
        self._boundary = b"--" + boundary.removeprefix("--").encode("latin-1", "replace")
        if len(self._boundary) < 3:
            raise CameraError("its stream has no boundary between pictures")
        self._buffer = bytearray()
        self._searched = 0  # number of bytes at the buffer's beginning that were searched and contain no boundary
        self._in_body = False
        self._length: int | None = None  # bytes of the body, if its header has a Content-Length
        self._began_s: float | None = None  # time of the body's first bytes; None: no bytes yet

    def feed(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Add bytes that arrived at `now_s`; return the complete bodies, each with the arrival (s) of its first bytes.

        Raises CameraError for a part that is too large to be a picture.
        """
        self._buffer += data
        if data and self._began_s is None:  # the picture's first bytes may arrive long after its header
            self._began_s = now_s
        chunks: list[tuple[float, bytes]] = []
        while self._in_body or self._header(now_s):
            body = self._body()
            if body is None:
                break
            if body:
                chunks.append((now_s if self._began_s is None else self._began_s, body))
        if len(self._buffer) > PART_BYTES_MAX:
            raise CameraError("its stream has a part that is too large for a picture")
        return chunks

    def _header(self, now_s: float) -> bool:
        """Consume a boundary and the header lines after it; return whether they are complete."""
        start = self._buffer.find(self._boundary)
        if start < 0:
            del self._buffer[: max(0, len(self._buffer) - len(self._boundary))]
            return False
        end, skip = self._buffer.find(b"\r\n\r\n", start), 4
        if end < 0:
            end, skip = self._buffer.find(b"\n\n", start), 2
        if end < 0:
            return False
        self._length = None
        for line in bytes(self._buffer[start:end]).splitlines()[1:]:
            name, _, value = line.partition(b":")
            if name.strip().lower() == b"content-length" and value.strip().isdigit():
                self._length = int(value)
        del self._buffer[: end + skip]
        self._in_body, self._searched = True, 0
        self._began_s = now_s if self._buffer else None
        return True

    def _body(self) -> bytes | None:
        """Return the body if it is complete, else None. A body without a length ends before the next boundary."""
        if self._length is not None:
            if len(self._buffer) < self._length:
                return None
            end = self._length
        else:
            end = self._buffer.find(self._boundary, self._searched)
            if end < 0:
                self._searched = max(0, len(self._buffer) - len(self._boundary))
                return None
        body = bytes(self._buffer[:end])
        del self._buffer[:end]
        self._in_body = False
        return body if self._length is not None else body.removesuffix(b"\n").removesuffix(b"\r")


class MjpegSource:
    """Pictures of one MJPEG address, stamped at the arrival of their first bytes."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller
        self._response: httpx.Response | None = None
        self._ready: deque[tuple[float, bytes]] = deque()

    def open(self) -> None:
        self._ready.clear()
        self._response = self._caller.get(SILENCE_S)
        try:
            self._multipart = Multipart(self._response.headers.get("content-type", ""))
        except CameraError:
            self.close()
            raise
        self._chunks: Iterator[bytes] = self._response.iter_raw()

    def shoot(self, stop: threading.Event) -> tuple[float, bytes | Picture]:
        while not self._ready:
            try:
                chunk = next(self._chunks, None)
            except httpx.HTTPError as error:
                raise CameraError(f"its stream broke: {type(error).__name__}") from None
            if chunk is None:
                raise CameraError("it ended its stream")
            self._ready.extend(self._multipart.feed(chunk, time.monotonic()))
        return self._ready.popleft()

    def close(self) -> None:
        if self._response is not None:
            self._response.close()
            self._response = None
