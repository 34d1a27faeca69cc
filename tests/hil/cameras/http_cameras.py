"""HTTP camera servers. The operating system chooses their ports."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

from tests.hil.cameras import picture_code

BOUNDARY = "a-boundary"


def jpeg(number: int) -> bytes:
    """Return the JPEG image that encodes this number."""
    rows = np.frombuffer(picture_code.drawn(number), np.uint8).reshape(picture_code.HEIGHT, picture_code.WIDTH, 3)
    return cv2.imencode(".jpg", rows)[1].tobytes()


class HttpServer:
    """HTTP server that answers GET requests with a function, until it is closed."""

    def __init__(self, answer) -> None:
        """The server calls `answer(handler)` for each GET, in a separate thread."""

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_GET(self) -> None:
                answer(self)

            def log_message(self, format, *args) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def url(self, path: str = "/picture.jpg", user: str = "") -> str:
        return f"http://{user + '@' if user else ''}127.0.0.1:{self.port}{path}"

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


def reply(handler, status: int, body: bytes, **headers: str) -> None:
    """Send a complete HTTP response."""
    handler.send_response(status)
    for name, value in {"Content-Length": str(len(body)), **headers}.items():
        handler.send_header(name.replace("_", "-"), value)
    handler.end_headers()
    handler.wfile.write(body)


class MjpegServer(HttpServer):
    """Sends a motion JPEG stream. Image n is sent n / rate_hz seconds after the start of the server."""

    def __init__(self, rate_hz: float = 20.0, *, lengths: bool = True, then_silent_after: int | None = None) -> None:
        self.rate_hz, self._lengths, self._silent_after = rate_hz, lengths, then_silent_after
        self.began_s = time.monotonic()
        self.streams = 0
        self.cut = threading.Event()  # if set, all streams end
        super().__init__(self._stream)

    def _stream(self, handler) -> None:
        self.streams += 1
        handler.send_response(200)
        handler.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
        handler.end_headers()
        handler.close_connection = True
        first = int((time.monotonic() - self.began_s) * self.rate_hz)
        try:
            for number in range(first, first + 100_000):
                wait_s = max(0.0, self.began_s + number / self.rate_hz - time.monotonic())
                if self.cut.wait(wait_s):
                    return
                if self._silent_after is not None and number - first >= self._silent_after:
                    self.cut.wait(60.0)
                    return
                self._send(handler, jpeg(number))
        except OSError:
            pass  # the client closed the connection

    def _send(self, handler, picture: bytes) -> None:
        length = f"Content-Length: {len(picture)}\r\n" if self._lengths else ""
        head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\n{length}\r\n"
        handler.wfile.write(head.encode() + picture + b"\r\n")
        handler.wfile.flush()

    def number_now(self) -> int:
        """Return the number of the current image."""
        return int((time.monotonic() - self.began_s) * self.rate_hz)
