"""The camera as a process: frames over HTTP, rendered where the truth bus says the drone is."""

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2

from dronecats.processes.bus_listener import Listener
from dronecats.sitl.camera import WorldCamera
from dronecats.sitl.config import CameraConfig
from dronecats.sitl.scenario import load_world
from episodes.optics.file import optics_of
from foundation.camera import CameraModel, Frame
from foundation.errors import DronecatsError
from hil.link.transport import bind_error

ENCODINGS = {
    "/frame.bmp": (".bmp", "image/bmp"),
    "/frame.jpg": (".jpg", "image/jpeg"),
    "/frame.png": (".png", "image/png"),
}


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
        host, port = "127.0.0.1", int(config.port)
        try:
            self._server = ThreadingHTTPServer((host, port), handler(self._camera))
        except OSError as error:
            raise bind_error(error, "TCP", host, port) from None
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def _announce(self, data: bytes) -> None:
        self._bus.send(data)

    def ready(self) -> dict[str, Any]:
        return {"url": f"http://127.0.0.1:{self._server.server_port}/frame.bmp"}

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


def handler(camera: WorldCamera) -> type[BaseHTTPRequestHandler]:
    """Return the request handler that serves the camera's newest frame, or with `at` that of a vehicle time in µs."""

    class FrameHandler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True

        def do_GET(self) -> None:
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
