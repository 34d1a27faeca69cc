"""The simulated forward camera: newest truth in, frames out, and word to the logger of each frame taken."""

import threading
from collections.abc import Callable

import numpy as np

from dronecats.border.camera import CameraModel, Frame
from dronecats.border.errors import CameraError
from dronecats.border.mavlink import Packer, dialect
from dronecats.border.truth import FrameTaken, NewestTruth, frame_message
from dronecats.sitl.scenario import origin
from episodes.render.pose import camera_pose
from episodes.render.renderer import Renderer
from episodes.world import World

CAMERA_COMPONENT = dialect.MAV_COMP_ID_CAMERA


class WorldCamera:
    """Renders what each drone sees from where it really is. Fed with the bytes of the truth bus."""

    def __init__(
        self, world: World, camera: CameraModel, announce: Callable[[bytes], None], *, rendered: bool = True
    ) -> None:
        """`rendered` False: every frame is plain grey, taken and announced like any other."""
        self.world, self.camera = world, camera
        self._announce = announce
        self._renderer = Renderer(world.scene, camera) if rendered else None
        self._grey = np.full((camera.height // 4, camera.width // 4, 3), 128, np.uint8)
        self._origin = origin(world)
        self._packer = Packer(1, CAMERA_COMPONENT)
        self._truth = NewestTruth(self._origin)
        self.feed = self._truth.feed  # bytes of the truth bus go in here
        self._t0_us: int | None = None
        self._frames = 0
        self._lock = threading.Lock()  # frames are asked for by server threads, one is drawn at a time

    def begin(self, t0_us: int) -> None:
        """From this vehicle time on the target moves."""
        self._t0_us = t0_us

    def warm_up(self) -> None:
        """Render once, for nobody: what has to be compiled is compiled now."""
        spawn = self.world.scene.spawn_ned
        pose = camera_pose((spawn[0], spawn[1], spawn[2] - 2.0), (1.0, 0.0, 0.0, 0.0), self.camera)
        with self._lock:
            if self._renderer:
                self._renderer.render(pose, self.world.moved(0.0))

    def newest(self, drone: int = 0) -> Frame:
        """Return a frame of the newest truth. Raises CameraError while nothing is known of the drone."""
        with self._lock:
            sample = self._truth.of(drone)
            if sample is None:
                raise CameraError(f"the camera has not heard where drone {drone} is")
            t_s = 0.0 if self._t0_us is None else max(0.0, (sample.time_us - self._t0_us) / 1e6)
            image = self._grey
            if self._renderer:
                pose = camera_pose(sample.position_ned, sample.attitude, self.camera)
                image = self._renderer.render(pose, self.world.moved(t_s)).rgb
            taken = FrameTaken(drone, self._frames, sample.time_us)
            self._frames += 1
            self._announce(self._packer.pack(frame_message(taken, sample, self._origin)))
            return Frame(taken.frame_id, drone, taken.time_us, image)

    def close(self) -> None:
        pass
