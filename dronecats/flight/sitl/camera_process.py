"""The camera as a process: frames over HTTP, rendered where the truth bus says the drone is."""

import contextlib
import errno
import socket
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2

from dronecats.flight.processes.bus_listener import Listener
from dronecats.flight.sitl.camera import WorldCamera
from dronecats.flight.sitl.config import CameraConfig
from dronecats.flight.sitl.scenario import load_world
from episodes.camera.optics.file import optics_of
from foundation.camera import CameraModel, Frame
from foundation.errors import DronecatsError
from hil.link.transport import bind_error

ENCODINGS = {
    "/frame.bmp": (".bmp", "image/bmp"),
    "/frame.jpg": (".jpg", "image/jpeg"),
    "/frame.png": (".png", "image/png"),
}
HOST = "127.0.0.1"
NEXT_PORTS = 100  # how many are tried, from the one that is wanted on
CONNECTIONS = 64  # open at once
REQUEST_S = 10.0  # wall s for a connection's first request to come
IDLE_S = 600.0  # wall s from one request of a connection to the next: a model may think that long


class CameraPart:
    """Part of a real-time flight. `/frame.bmp` is what the agent takes: nothing of the picture is lost on the wire."""

    def __init__(self, config: CameraConfig) -> None:
        optics = optics_of(config.optics, "optics") if config.optics else None
        world = load_world(config.episode, config.airframe, config.count)
        self._camera = WorldCamera(
            world, CameraModel(), self._announce, optics=optics, seed=config.seed, kept=config.kept
        )
        self._bus = Listener(config.truth, self._camera.feed)
        self._camera.warm_up()  # compiles, on the first run of an installation
        self._server = serve(self._camera, config.port, or_next_free=config.or_next_free)
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def _announce(self, data: bytes) -> None:
        self._bus.send(data)

    def ready(self) -> dict[str, Any]:
        return {"url": f"http://{HOST}:{self._server.server_port}/frame.bmp"}

    def do(self, command: str, arguments: dict[str, Any]) -> Any:
        if command == "begin":
            self._camera.begin(arguments["t0_us"])
        return None

    def turn(self) -> None:
        self._bus.read(0.02)

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._bus.close()
        self._camera.close()


class FrameServer(ThreadingHTTPServer):
    """A server that goes on serving however many connections are opened: of those that never asked, the oldest goes."""

    daemon_threads = True
    request_queue_size = 2 * CONNECTIONS

    def __init__(self, address: tuple[str, int], handler_class: type[BaseHTTPRequestHandler]) -> None:
        self._lock = threading.Lock()
        self._silent: dict[socket.socket, None] = {}  # no whole request yet, in the order in which they came
        self._known: set[socket.socket] = set()
        super().__init__(address, handler_class)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            if len(self._silent) + len(self._known) >= CONNECTIONS:
                oldest = next(iter(self._silent), request)
                self._silent.pop(oldest, None)
                with contextlib.suppress(OSError):  # it has just gone
                    oldest.shutdown(socket.SHUT_RDWR)
            self._silent[request] = None
        super().process_request(request, client_address)

    def asked(self, request: socket.socket) -> None:
        """Note that a connection has sent a whole request, so that it is kept."""
        request.settimeout(IDLE_S)
        with self._lock:
            if request in self._silent:
                del self._silent[request]
                self._known.add(request)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._silent.pop(request, None)
            self._known.discard(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print an error of the handler. A client that closes its connection early is none."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def serve(camera: WorldCamera, port: int, *, or_next_free: bool = False) -> FrameServer:
    """Return a server of a camera's frames on a loopback port, with `or_next_free` on the next one where it is in use.

    Port 0 is one that the system chooses. Raises UsageError.
    """
    ports = range(port, min(port + NEXT_PORTS, 65536)) if or_next_free else [port]
    for candidate in ports:
        try:
            return FrameServer((HOST, candidate), handler(camera))
        except OSError as error:
            if error.errno != errno.EADDRINUSE or candidate == ports[-1]:
                raise bind_error(error, "TCP", HOST, candidate) from None
    raise AssertionError("there is at least one port")


def handler(camera: WorldCamera) -> type[BaseHTTPRequestHandler]:
    """Return the request handler that serves the camera's newest frame, or with `at` that of a vehicle time in µs."""

    class FrameHandler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True
        timeout = REQUEST_S

        def do_GET(self) -> None:
            if isinstance(self.server, FrameServer):
                self.server.asked(self.connection)
            parts = urlsplit(self.path)
            if parts.path not in ENCODINGS:
                self._send(404, "text/plain", b"frames are at /frame.bmp, /frame.jpg and /frame.png\n", {})
                return
            try:
                asked = parse_qs(parts.query)
                drone = int(asked.get("drone", ["0"])[0])
                frame = camera.at(int(asked["at"][0]), drone) if "at" in asked else camera.newest(drone)
            except (ValueError, DronecatsError) as error:
                self._send(503, "text/plain", f"{error}\n".encode(), {})
                return
            extension, kind = ENCODINGS[parts.path]
            data = cv2.imencode(extension, cv2.cvtColor(frame.image_rgb, cv2.COLOR_RGB2BGR))[1].tobytes()
            self._send(200, kind, data, stamp(frame))

        def _send(self, status: int, kind: str, data: bytes, headers: dict[str, str]) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    return FrameHandler


def stamp(frame: Frame) -> dict[str, str]:
    """Return the headers that say which frame this is and when it was taken."""
    return {"X-Frame-Id": str(frame.frame_id), "X-Frame-Time-Us": str(frame.time_us)}


def create(config: CameraConfig) -> CameraPart:
    """Return the camera of an episode. Raises UsageError."""
    return CameraPart(config)
