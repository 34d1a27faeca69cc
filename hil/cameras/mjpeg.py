"""Motion JPEG over HTTP: one endless answer (multipart/x-mixed-replace) of pictures."""

import threading
import time
from collections import deque
from collections.abc import Iterator

import httpx

from foundation.errors import CameraError
from hil.cameras.http import Caller
from hil.cameras.stream import Picture

PART_BYTES_MAX = 32 * 1024 * 1024
SILENCE_S = 2.0  # s without a byte after which the stream is taken for broken


class Multipart:
    """Cuts the bytes of a multipart answer into its parts. Pure: the caller says when the bytes came."""

    def __init__(self, content_type: str) -> None:
        """Raises CameraError when the header names no boundary."""
        boundary = content_type.partition("boundary=")[2].split(";")[0].strip().strip('"')
        # some cameras write the two leading dashes into the header, others do not
        self._boundary = b"--" + boundary.removeprefix("--").encode("latin-1", "replace")
        if len(self._boundary) < 3:
            raise CameraError("its stream names no boundary between pictures")
        self._buffer = bytearray()
        self._searched = 0  # bytes of the buffer in which no boundary begins
        self._in_body = False
        self._length: int | None = None  # bytes of the body, when its header says so
        self._began_s: float | None = None  # when the body's first bytes came; None while there are none

    def feed(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Take bytes; return the parts that are complete, each with the second at which its body began to come.

        Raises CameraError for a part that is too large to be a picture.
        """
        self._buffer += data
        if data and self._began_s is None:  # a header may come alone and wait long for its picture
            self._began_s = now_s
        parts: list[tuple[float, bytes]] = []
        while self._in_body or self._header(now_s):
            body = self._body()
            if body is None:
                break
            if body:
                parts.append((now_s if self._began_s is None else self._began_s, body))
        if len(self._buffer) > PART_BYTES_MAX:
            raise CameraError("its stream sends a part that is too large for a picture")
        return parts

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
        """Return the body when it is complete; it ends where its length or the next boundary says."""
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
    """Pictures of one MJPEG address, stamped when their first bytes come."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller
        self._response: httpx.Response | None = None
        self._ready: deque[tuple[float, bytes]] = deque()

    def open(self) -> None:
        self._ready.clear()
        self._response = self._caller.get(SILENCE_S)
        self._parts = Multipart(self._response.headers.get("content-type", ""))
        self._chunks: Iterator[bytes] = self._response.iter_raw()

    def shoot(self, stop: threading.Event) -> tuple[float, bytes | Picture]:
        while not self._ready:
            try:
                chunk = next(self._chunks, None)
            except httpx.HTTPError as error:
                raise CameraError(f"its stream broke: {type(error).__name__}") from None
            if chunk is None:
                raise CameraError("it ended its stream")
            self._ready.extend(self._parts.feed(chunk, time.monotonic()))
        return self._ready.popleft()

    def close(self) -> None:
        if self._response is not None:
            self._response.close()
            self._response = None
