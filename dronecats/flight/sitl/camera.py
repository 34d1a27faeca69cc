"""The simulated camera, and the process that serves its frames over HTTP.

The camera renders frames from the poses on the truth bus, and announces each frame on the bus for the logger.
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
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

import cv2
import numpy as np
from numpy.typing import NDArray

from dronecats.flight.sitl.config import AIRFRAME, CameraConfig
from dronecats.flight.sitl.episode_world import load_world, origin
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
# Samples per pixel, in each direction, of a picture rendered at the reduced size (640 px wide). The full size has 2.
# Its pixels are half as wide with the default camera (1280 px), so both have the same density of samples.
GRAIN = 4
DEPTHS_KEPT = 32  # number of newest frames whose depth pictures are kept
STALE_S = 0.5  # s; body rates are not computed from samples that are farther apart in time
_warm: set[type] = set()  # renderer classes that this process has warmed up
_warm_lock = threading.Lock()


class WorldCamera:
    """Renders the images of each drone's camera from the true poses on the truth bus.

    Frames have the size that the model gets, unless the caller requests the camera's full size. A camera with optics
    models a sensor, so its picture is rendered at full size and then reduced.
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
        """`rendered` False: every frame is plain grey, but is announced as usual.

        `optics` affects only the pictures; None: the benchmark's camera. `seed` seeds random effects in the pictures;
        it differs between flights of one episode. `kept`: truth samples per drone that `at` can use. `depth`: every
        frame has a depth picture, even if no client requests it.
        """
        self.world, self.camera = world, camera
        self._announce = announce
        self._seed = (world.record.seed, seed)
        self._rendered, self._optics, self._depth = rendered, optics, depth
        self._depths: OrderedDict[int, NDArray[np.uint16]] = OrderedDict()  # depth pictures of the newest frames, by id
        self._renderers: dict[bool, Renderer | OpticalRenderer] = {}  # key: full size or not; created when first needed
        self._grey = np.full((camera.height // 4, camera.width // 4, 3), 128, np.uint8)
        self._origin = origin(world)
        self._packer = Packer(1, CAMERA_COMPONENT)
        self._truth = NewestTruth(self._origin, kept)
        self._t0_us: int | None = None
        self._frames = 0
        self._lock = threading.Lock()  # several server threads request frames; only one frame is rendered at a time

    def feed(self, data: bytes) -> None:
        self._truth.feed(data)

    def begin(self, t0_us: int) -> None:
        """Start the motion of the target at this vehicle time."""
        self._t0_us = t0_us

    def warm_up(self) -> None:
        """Compile the kernels, once per process, by rendering a picture that is dropped."""
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
        """Return a frame of the newest time with a truth sample of every drone (see `NewestTruth.together`).

        Raises CameraError if no pose of the drone has arrived, or if the camera cannot make a requested depth picture.
        """
        with self._lock:
            return self._taken(drone, self._truth.together(drone), full, depth or self._depth)

    def at(self, time_us: int, drone: int = 0, *, full: bool = False, depth: bool = False) -> Frame:
        """Return a frame of a past time (µs, vehicle clock): of the first truth sample at that time or after it.

        Raises CameraError like `newest`.
        """
        with self._lock:
            return self._taken(drone, self._truth.at(drone, time_us), full, depth or self._depth)

    def depth_of(self, frame_id: int) -> NDArray[np.uint16]:
        """Return the depth picture of a frame. Raises CameraError if the picture is not kept, or was not rendered."""
        with self._lock:
            if frame_id not in self._depths:
                raise CameraError(f"the camera keeps no depth picture of frame {frame_id}")
            return self._depths[frame_id]

    def _taken(
        self, drone: int, samples: tuple[TruthSample, dict[int, TruthSample]] | None, full: bool, depth: bool
    ) -> Frame:
        """Render the frame of a drone, announce it on the truth bus, and return it.

        `samples`: the drone's truth sample, and those of the other drones by number. None: no pose has arrived yet.
        Raises CameraError like `newest`.
        """
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
        """Return the picture from the pose of `sample`, and the depth picture (mm) if `depth`.

        `fleet`: the other drones at that time. `t_s`: time in s of the episode, which gives the target's pose.
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
        """End the renderers' threads. Do not request frames afterwards."""
        for renderer in self._renderers.values():
            renderer.close()


def _after(drones: Mapping[int, TruthSample], seconds: float) -> dict[int, DronePose]:
    """Return the poses of drones, extrapolated by some seconds at constant velocity."""
    poses = {}
    for number, sample in drones.items():
        (n, e, d), (vn, ve, vd) = sample.position_ned, sample.velocity_ned
        poses[number] = DronePose((n + vn * seconds, e + ve * seconds, d + vd * seconds), sample.attitude)
    return poses


def rates_between(before: TruthSample, after: TruthSample) -> Vec3:
    """Return the mean body rates (rad/s, FRD) between two samples; zero if the time between them is 0 or ≥ STALE_S."""
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
NEXT_PORTS = 100  # number of ports to try, from the requested one upwards
CONNECTIONS = 64  # largest number of connections that are open at the same time
REQUEST_S = 10.0  # wall s to wait for the first request of a connection
IDLE_S = 600.0  # wall s to wait for the next request of a connection; a model may think for minutes


class CameraPart:
    """The camera process of a real-time flight. The agent gets bitmaps, so no compression changes the picture."""

    def __init__(self, config: CameraConfig) -> None:
        """Raises UsageError."""
        optics = optics_of(config.optics, "optics") if config.optics else None
        world = load_world(config.episode, config.airframe, config.count, config.conditions)
        camera = camera_on(airframes.load(config.airframe or AIRFRAME).camera)
        self._camera = WorldCamera(world, camera, self._announce, optics=optics, seed=config.seed, kept=config.kept)
        self._bus = Listener(config.truth, self._camera.feed)
        self._camera.warm_up()  # compiles the kernels on the first run of an installation
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


class FrameHandler(BaseHTTPRequestHandler):
    """Serves the newest frame, or with `?at=` the frame of a vehicle time (µs)."""

    server: "FrameServer"
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    timeout = REQUEST_S

    def do_GET(self) -> None:
        self.server.keep(self.connection)
        url = urlsplit(self.path)
        if url.path not in (*ENCODINGS, DEPTH):
            self._send(404, "text/plain", b"frames are at /frame.bmp, /frame.jpg, /frame.png and /depth.png\n", {})
            return
        try:
            kind, data, headers = self._answer(url.path, dict(parse_qsl(url.query)))
        except (ValueError, DronecatsError) as error:
            self._send(503, "text/plain", f"{error}\n".encode(), {})
            return
        self._send(200, kind, data, headers)

    def _answer(self, path: str, query: dict[str, str]) -> tuple[str, bytes, dict[str, str]]:
        """Return the media type, data and headers for a request. Raises ValueError, DronecatsError."""
        camera = self.server.camera
        own_width = camera.camera.width
        drone, width = int(query.get("drone", 0)), int(query.get("width", own_width))
        if width not in (own_width, WIDTH_MAX):
            raise ValueError(f"frames are {WIDTH_MAX} or {own_width} px wide, not {width}")
        if path == DEPTH and "frame" in query:
            return "image/png", encode_depth(camera.depth_of(int(query["frame"]))), {}
        take = partial(camera.at, int(query["at"])) if "at" in query else camera.newest
        frame = take(drone, full=width == own_width, depth=path == DEPTH or query.get("depth") == "1")
        headers = {"X-Frame-Id": str(frame.frame_id), "X-Frame-Time-Us": str(frame.time_us)}
        if path == DEPTH and frame.depth_mm is not None:
            return "image/png", encode_depth(frame.depth_mm), headers
        extension, kind = ENCODINGS[path]
        data = cv2.imencode(extension, cv2.cvtColor(frame.image_rgb, cv2.COLOR_RGB2BGR))[1].tobytes()
        return kind, data, headers

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


class FrameServer(ThreadingHTTPServer):
    """An HTTP server for a camera's frames, with CONNECTIONS connections at most.

    At this limit, a new connection replaces the oldest one that has not sent a request. If there is none, the new
    connection is closed.
    """

    daemon_threads = True
    request_queue_size = 2 * CONNECTIONS

    def __init__(self, address: tuple[str, int], camera: WorldCamera) -> None:
        self.camera = camera
        self._lock = threading.Lock()
        self._silent: dict[socket.socket, None] = {}  # connections that have not sent a whole request, oldest first
        self._active: set[socket.socket] = set()
        super().__init__(address, FrameHandler)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._lock:
            if len(self._silent) + len(self._active) >= CONNECTIONS:
                oldest = next(iter(self._silent), request)
                self._silent.pop(oldest, None)
                with contextlib.suppress(OSError):  # the client has closed it already
                    oldest.shutdown(socket.SHUT_RDWR)
            self._silent[request] = None
        super().process_request(request, client_address)

    def keep(self, request: socket.socket) -> None:
        """Mark a connection that has sent a whole request, so that it stays open."""
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
        """Print an error of the handler, unless the client closed its connection early."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


def serve(camera: WorldCamera, port: int, *, or_next_free: bool = False) -> FrameServer:
    """Return a server of a camera's frames on a loopback port; port 0: the system chooses one.

    `or_next_free`: if the port is in use, take the next free one. Raises UsageError if no port can be opened.
    """
    ports = range(port, min(port + NEXT_PORTS, 65536)) if or_next_free else [port]
    for candidate in ports:
        try:
            return FrameServer((HOST, candidate), camera)
        except OSError as error:
            if error.errno != errno.EADDRINUSE or candidate == ports[-1]:
                raise bind_error(error, "TCP", HOST, candidate) from None
    raise AssertionError("there is at least one port")
