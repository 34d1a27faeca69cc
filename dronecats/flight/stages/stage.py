"""What an episode is flown on: vehicles to command, a camera, a clock, and a logger that looks on."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Protocol

from foundation.camera import Camera, CameraModel
from foundation.errors import DronecatsError
from hil.link.link import Link


class TruthTap(Protocol):
    """Somebody's end of the truth bus, who is not the agent."""

    def drain(self) -> None:
        """Take in what has come."""
        ...

    def close(self) -> None: ...


class Stage(Protocol):
    """Lockstep in one process, or real time over sockets: the episode does not know which. Nor does it decide here."""

    @property
    def links(self) -> Sequence[Link]: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def camera_model(self) -> CameraModel: ...
    @property
    def executor(self) -> Executor:
        """Where what may take long is called."""
        ...

    @property
    def lockstep(self) -> bool:
        """Whether the vehicle's clock waits, and everything is in this process."""
        ...

    @property
    def speed(self) -> float | None:
        """The factor on real time at which the vehicle's clock should run; None: it waits."""
        ...

    def begin(self, t0_us: int, cap_s: float) -> None:
        """The episode's clock is zero at this vehicle time, for the camera, the logger and the targets.

        `cap_s`: the length of the flight in seconds, for the log.
        """
        ...

    def mend(self) -> None:
        """What is disturbed on purpose between agent and vehicles is not from now on: they are told to land."""
        ...

    def end(self, reason: str, error: str | None = None) -> None:
        """Tell the logger that the episode is over."""
        ...

    def check(self) -> None:
        """Raise InfrastructureError if something the flight stands on is gone."""
        ...

    def check_vehicles(self) -> None:
        """Raise InfrastructureError if what simulates the vehicles is gone: then none of them can be told to land."""
        ...

    def cause(self, error: DronecatsError) -> DronecatsError:
        """Return what has brought an error about: the error of a process that is gone or hangs, else `error` itself.

        May take some seconds.
        """
        ...

    def close(self) -> None: ...


class TruthfulStage(Stage, Protocol):
    """A stage on which the truth is known."""

    def tap(self, feed: Callable[[bytes], None]) -> TruthTap:
        """Have the truth bus fed to somebody, for instance the oracle."""
        ...
