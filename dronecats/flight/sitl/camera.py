"""The simulated forward camera, and the process that serves its frames over HTTP: newest truth in, frames out.

The logger hears of every frame that was taken.
"""

import contextlib
import dataclasses
import errno
import math
import socket
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.flight.sitl.config import AIRFRAME, CameraConfig
from dronecats.flight.sitl.simulation import load_world, origin
from dronecats.flight.sitl.truth_listener import Listener
from episodes.camera.optics.camera import OpticalRenderer, VehicleMotion
from episodes.camera.optics.file import optics_of
from episodes.camera.optics.options import Optics
from episodes.camera.renderer.renderer import Renderer
from episodes.world.fleet import DronePose
from episodes.world.world import World
from foundation.camera import (
    WIDTH_MAX,
    CameraModel,
    Frame,
    camera_on,
    camera_pose,
    encode_depth,
    in_millimetres,
    reduced,
    reduced_size,
)
from foundation.errors import CameraError, DronecatsError
from foundation.frames import Vec3, quat_conjugate, quat_multiply
from foundation.mavlink import Packer, dialect
from foundation.truth import KEPT, FrameTaken, NewestTruth, TruthSample, frame_message
from hil.link.transport import bind_error
from vehicles import airframe as airframes

CAMERA_COMPONENT = dialect.MAV_COMP_ID_CAMERA
GRAIN = 4  # samples of a pixel per direction of a reduced picture: as many as two pixels of the full one have
DEPTHS_KEPT = 32  # depth pictures of the newest frames
STALE_S = 0.5  # samples farther apart say nothing about rates
_warm: set[type] = set()  # the kinds of renderers that have drawn in this process
_warm_lock = threading.Lock()


class WorldCamera:
    """Renders what each drone sees from where it really is. Fed with the bytes of the truth bus.

    Frames come at the size at which the model gets them, unless the camera's full size is asked for. A camera with
    optics has a sensor: its picture is drawn in full, and then reduced.
    """

    def __init__(
        self,
        world: World,
        camera: CameraModel,
        announce: Callable[[bytes], None],
        *,
        rendered: bool = True,
        optics: Optics | None = None,
        seed: int = 0,
        kept: int = KEPT,
        depth: bool = False,
    ) -> None:
        """`rendered` False: every frame is plain grey, taken and announced like any other.

        `optics` changes the pictures and nothing else; None is the benchmark's camera. `seed` tells flights of one
        episode apart: what is random in their pictures. `kept`: samples of the truth of each drone that `at` can go
        back to. `depth`: frames have a depth picture even if no client asks for it.
        """
        self.world, self.camera = world, camera
        self._announce = announce
        self._seed = (world.record.seed, seed)
        self._rendered, self._optics, self._depth = rendered, optics, depth
        self._depths: OrderedDict[int, NDArray[np.uint16]] = OrderedDict()  # of the newest frames that have one, by id
        self._renderers: dict[bool, Renderer | OpticalRenderer] = {}  # of full pictures or not, made when first needed
        self._grey = np.full((camera.height // 4, camera.width // 4, 3), 128, np.uint8)
        self._origin = origin(world)
        self._packer = Packer(1, CAMERA_COMPONENT)
        self._truth = NewestTruth(self._origin, kept)
        self._t0_us: int | None = None
        self._frames = 0
        self._lock = threading.Lock()  # frames are asked for by server threads, one is drawn at a time

    def feed(self, data: bytes) -> None:
        """Take bytes of the truth bus."""
        self._truth.feed(data)

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves."""
        self._t0_us = t0_us

    def warm_up(self) -> None:
        """Render once and drop the picture, so that the kernels are compiled, once for all cameras of a process."""
        with _warm_lock:
            kind = OpticalRenderer if self._optics else Renderer
            if kind in _warm or not self._rendered:
                return
            _warm.add(kind)
        spawn = self.world.scene.spawn_ned
        place = (spawn[0], spawn[1], spawn[2] - 2.0)
        with self._lock:
            self._picture(TruthSample(0, 0, place, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), {}, 0.0, 0, full=False)

    def newest(self, drone: int = 0, *, full: bool = False, depth: bool = False) -> Frame:
        """Return a frame of the newest truth, of a fleet the newest that is known of all of it.

        Raises CameraError while nothing is known of the drone, and for a depth picture that the camera cannot have.
        """
        with self._lock:
            return self._taken(drone, self._truth.together(drone), full, depth or self._depth)

    def at(self, time_us: int, drone: int = 0, *, full: bool = False, depth: bool = False) -> Frame:
        """Return a frame of a moment ago (µs, vehicle clock): of the first truth at that time or after it.

        Raises CameraError as `newest` does.
        """
        with self._lock:
            return self._taken(drone, self._truth.at(drone, time_us), full, depth or self._depth)

    def depth_of(self, frame_id: int) -> NDArray[np.uint16]:
        """Return the depth picture of a frame that was taken with one. Raises CameraError if it is not kept."""
        with self._lock:
            if frame_id not in self._depths:
                raise CameraError(f"the camera keeps no depth picture of frame {frame_id}")
            return self._depths[frame_id]

    def _taken(
        self, drone: int, samples: tuple[TruthSample, dict[int, TruthSample]] | None, full: bool, depth: bool
    ) -> Frame:
        """Return a frame of a sample and the others' of its time, and say that it was taken."""
        if samples is None:
            raise CameraError(f"the camera has received no pose of drone {drone + 1}")
        if depth and (self._optics or not self._rendered):
            raise CameraError("a camera with optics, or without rendering, has no depth picture")
        sample, fleet = samples
        t_s = 0.0 if self._t0_us is None else max(0.0, (sample.time_us - self._t0_us) / 1e6)
        image, depth_mm = self._picture(sample, fleet, t_s, self._frames, full, depth)
        taken = FrameTaken(drone, self._frames, sample.time_us)
        self._frames += 1
        if depth_mm is not None:
            self._depths[taken.frame_id] = depth_mm
            if len(self._depths) > DEPTHS_KEPT:
                self._depths.popitem(last=False)
        self._announce(self._packer.pack(frame_message(taken, sample, self._origin)))
        return Frame(taken.frame_id, drone, taken.time_us, image, depth_mm)

    def _picture(
        self,
        sample: TruthSample,
        fleet: Mapping[int, TruthSample],
        t_s: float,
        frame_id: int,
        full: bool,
        depth: bool = False,
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16] | None]:
        """Return the picture from `sample`, and its depth where it is wanted.

        The other drones are where they are and the target is where it is at `t_s`.
        """
        if not self._rendered:
            return self._grey, None
        renderer = self._renderer(full)
        if isinstance(renderer, Renderer):
            pose = camera_pose(sample.position_ned, sample.attitude, self.camera.at_pitch(sample.gimbal_pitch))
            moved = self.world.moved(t_s, _after(fleet, 0.0))
            if not depth:
                return renderer.picture(pose, moved), None
            view = renderer.render(pose, moved)
            return view.rgb, in_millimetres(view.depth)
        rates = rates_between(self._truth.before(sample), sample)
        motion = VehicleMotion(
            t_s, sample.position_ned, sample.velocity_ned, sample.attitude, rates, sample.gimbal_pitch
        )
        picture = renderer.picture(
            motion,
            lambda t: self.world.moved(max(0.0, t), _after(fleet, t - t_s)),
            (*self._seed, sample.drone, frame_id),
        )
        return (picture if full else reduced(picture)), None

    def _renderer(self, full: bool) -> Renderer | OpticalRenderer:
        full = full or self._optics is not None or self.camera.width <= WIDTH_MAX
        if full not in self._renderers:
            camera, scene = self.camera, self.world.filmed
            if self._optics:
                self._renderers[full] = OpticalRenderer(scene, camera, self._optics)
            elif full:
                self._renderers[full] = Renderer(scene, camera)
            else:
                width, height = reduced_size(camera.width, camera.height)
                small = dataclasses.replace(camera, width=width, height=height)
                self._renderers[full] = Renderer(scene, small, grain=GRAIN)
        return self._renderers[full]

    def close(self) -> None:
        """Let the renderers' threads go; no frame is asked for afterwards."""
        for renderer in self._renderers.values():
            renderer.close()


def _after(drones: Mapping[int, TruthSample], seconds: float) -> dict[int, DronePose]:
    """Return the poses of drones after some seconds at constant velocity."""
    poses = {}
    for number, sample in drones.items():
        (n, e, d), (vn, ve, vd) = sample.position_ned, sample.velocity_ned
        poses[number] = DronePose((n + vn * seconds, e + ve * seconds, d + vd * seconds), sample.attitude)
    return poses


def rates_between(before: TruthSample, after: TruthSample) -> Vec3:
    """Return the mean body rates (rad/s, FRD) from one sample to the next; zero when they are one and the same."""
    seconds = (after.time_us - before.time_us) / 1e6
    if not 0.0 < seconds < STALE_S:
        return (0.0, 0.0, 0.0)
    w, x, y, z = quat_multiply(quat_conjugate(before.attitude), after.attitude)
    half = math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))
    scale = math.copysign(2.0 * half / (math.sin(half) * seconds), w) if half > 1e-9 else 0.0
    return (scale * x, scale * y, scale * z)


ENCODINGS = {
    "/frame.bmp": (".bmp", "image/bmp"),
    "/frame.jpg": (".jpg", "image/jpeg"),
    "/frame.png": (".png", "image/png"),
}
DEPTH = "/depth.png"
HOST = "127.0.0.1"
NEXT_PORTS = 100  # how many are tried, from the one that is wanted on
CONNECTIONS = 64  # open at once
REQUEST_S = 10.0  # wall s for a connection's first request to come
IDLE_S = 600.0  # wall s from one request of a connection to the next: a model may think that long


class CameraPart:
    """Part of a real-time flight. The agent takes bitmaps: nothing of the picture is lost on the wire."""

    def __init__(self, config: CameraConfig) -> None:
        optics = optics_of(config.optics, "optics") if config.optics else None
        world = load_world(config.episode, config.airframe, config.count, config.conditions)
        camera = camera_on(airframes.load(config.airframe or AIRFRAME).camera)
        self._camera = WorldCamera(world, camera, self._announce, optics=optics, seed=config.seed, kept=config.kept)
        self._bus = Listener(config.truth, self._camera.feed)
        self._camera.warm_up()  # compiles, on the first run of an installation
        self._server = serve(self._camera, config.port, or_next_free=config.or_next_free)
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def _announce(self, data: bytes) -> None:
        self._bus.send(data)

    def ready(self) -> dict[str, Any]:
        url = f"http://{HOST}:{self._server.server_port}/frame.bmp"
        depth = f"http://{HOST}:{self._server.server_port}{DEPTH}"
        return {"url": url, "reduced": f"{url}?width={WIDTH_MAX}", "depth": depth}

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
        self._active: set[socket.socket] = set()
        super().__init__(address, handler_class)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            if len(self._silent) + len(self._active) >= CONNECTIONS:
                oldest = next(iter(self._silent), request)
                self._silent.pop(oldest, None)
                with contextlib.suppress(OSError):  # it has just gone
                    oldest.shutdown(socket.SHUT_RDWR)
            self._silent[request] = None
        super().process_request(request, client_address)

    def keep(self, request: socket.socket) -> None:
        """Note that a connection has sent a whole request, so that it is kept."""
        request.settimeout(IDLE_S)
        with self._lock:
            if request in self._silent:
                del self._silent[request]
                self._active.add(request)

    def shutdown_request(self, request: Any) -> None:
        with self._lock:
            self._silent.pop(request, None)
            self._active.discard(request)
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
                self.server.keep(self.connection)
            url = urlsplit(self.path)
            if url.path not in (*ENCODINGS, DEPTH):
                self._send(404, "text/plain", b"frames are at /frame.bmp, /frame.jpg, /frame.png and /depth.png\n", {})
                return
            try:
                query = parse_qs(url.query)
                drone, width = int(query.get("drone", ["0"])[0]), int(query.get("width", [str(camera.camera.width)])[0])
                full = width == camera.camera.width
                if not full and width != WIDTH_MAX:
                    raise ValueError(f"frames are {WIDTH_MAX} or {camera.camera.width} px wide, not {width}")
                if url.path == DEPTH and "frame" in query:
                    self._send(200, "image/png", encode_depth(camera.depth_of(int(query["frame"][0]))), {})
                    return
                at = int(query["at"][0]) if "at" in query else None
                depth = url.path == DEPTH or query.get("depth", ["0"])[0] == "1"
                frame = (
                    camera.newest(drone, full=full, depth=depth)
                    if at is None
                    else camera.at(at, drone, full=full, depth=depth)
                )
            except (ValueError, DronecatsError) as error:
                self._send(503, "text/plain", f"{error}\n".encode(), {})
                return
            if url.path == DEPTH and frame.depth_mm is not None:
                self._send(200, "image/png", encode_depth(frame.depth_mm), stamp(frame))
                return
            extension, kind = ENCODINGS[url.path]
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
