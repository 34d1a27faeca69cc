"""What an episode is flown on: vehicles to command, a camera, a model, and a logger that looks on."""

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Protocol

from dronecats.agent.models.model import Model
from foundation.camera import Camera, CameraModel
from hil.link.link import Link


class Stage(Protocol):
    """Lockstep in one process, or real time over sockets: the episode does not know which."""

    @property
    def links(self) -> Sequence[Link]: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def camera_model(self) -> CameraModel: ...
    @property
    def model(self) -> Model: ...
    @property
    def executor(self) -> Executor: ...

    def begin(self, t0_us: int, cap_s: float) -> None:
        """The episode's clock is zero at this vehicle time, for the camera, the logger and the targets.

        `cap_s`: the length of the flight in seconds, for the log.
        """
        ...

    def end(self, reason: str, error: str | None = None) -> None:
        """Tell the logger that the episode is over."""
        ...

    def check(self) -> None:
        """Raise InfrastructureError if something the flight stands on is gone."""
        ...

    def close(self) -> None: ...
