"""The interface between an agent and one episode: vehicles, camera, clock and logs. An agent gets nothing else."""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from dronecats.agent.controller import Aircraft
from dronecats.agent.pictures import PicturePath
from foundation.camera import Camera, CameraModel, Frame, encode, encode_depth
from foundation.protocol import CAP_S
from foundation.run_folder.layout import depth_name, frame_name
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog, PromptLog


class HostPace:
    """The wall clock that paces the vehicle's clock. Each HostWatch measures how far the vehicle's clock falls behind.

    A delay of the host computer must not count as a delay of the model (paper, "Throughput sensitivity"). Only flights
    in real time have a HostPace; in lockstep, the vehicle's clock waits for the host.
    """

    def __init__(self, wall_s: Callable[[], float], speed: float) -> None:
        """`wall_s` returns the wall time (s). `speed` is the intended ratio of vehicle time to wall time."""
        self._wall_s, self._speed = wall_s, speed
        self._watches: list[HostWatch] = []

    @property
    def now_s(self) -> float:
        """Wall time × speed (s), from an arbitrary zero. The difference to vehicle time grows when the host is late."""
        return self._wall_s() * self._speed

    def watch(self) -> "HostWatch":
        """Return a new watch for one `Decider`. It starts now."""
        self._watches.append(HostWatch(self))
        return self._watches[-1]

    def tick(self, vehicle_s: float) -> None:
        """Report the vehicle's time (s) at its newest telemetry."""
        late_s = self.now_s - vehicle_s
        for watch in self._watches:
            watch.late(late_s)


class HostWatch:
    """Measures the delays of the host since the last `take`."""

    def __init__(self, pace: HostPace) -> None:
        self.pace = pace
        self._least_s = self._newest_s = math.inf  # s, smallest `late_s` since the last `take`, and the newest
        self._lag_s = 0.0
        self._waited_s = 0.0

    def late(self, late_s: float) -> None:
        """Update the lag with `late_s`: wall time × speed, minus vehicle time (s, plus an unknown constant).

        The lag since the last `take` is the largest rise of `late_s` above an earlier value.
        """
        self._least_s, self._newest_s = min(self._least_s, late_s), late_s
        self._lag_s = max(self._lag_s, late_s - self._least_s)

    def waited(self, seconds: float) -> None:
        """Add the time (wall time × speed, s) that the agent waited for one picture."""
        self._waited_s += seconds

    def take(self) -> tuple[float, float]:
        """Return (s by which the vehicle's clock fell behind, s of waiting for pictures) since the last call."""
        taken = self._lag_s, self._waited_s
        # start again from the newest lateness, so that a stall that begins now counts for the next step
        self._least_s, self._lag_s, self._waited_s = self._newest_s, 0.0, 0.0
        return taken


def _nothing(*_: object) -> None:
    """Do nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cockpit:
    """One episode's vehicles, camera and logs. Episode time counts from `t0_us` on the vehicles' clock."""

    aircraft: Sequence[Aircraft]  # one per drone, in a fixed order
    camera: Camera
    camera_model: CameraModel
    log: LineLog
    frames_dir: Path
    executor: Executor  # runs calls that may take long
    t0_us: int  # µs, the vehicles' clock when the episode began
    prompts: PromptLog | None = None  # logs the text of every question; None: prompts are not logged
    commander_log: Path | None = None  # log of the questions to a commander and its replies; None: not logged
    seed: tuple[int, ...] = (0,)  # seeds all random draws of the agent
    on_step: Callable[[Decision], None] = _nothing  # called with every decision
    on_tick: Callable[[], None] = _nothing  # called at every tick; an exception in it ends the flight
    pictures: PicturePath | None = None  # declared disturbances of pictures, such as a delay; None: none
    host: HostPace | None = None  # paces the vehicle's clock in real time; None: lockstep

    def keep_pictures(self, frames: Sequence[Frame]) -> tuple[bytes, ...]:
        """Return frames as JPEGs for a model. Write each JPEG, with the depth image if any, into the run folder."""
        pictures = tuple(encode(frame.image_rgb) for frame in frames)
        for frame, jpeg in zip(frames, pictures, strict=True):
            (self.frames_dir / frame_name(frame.frame_id, frame.drone)).write_bytes(jpeg)
            if frame.depth_mm is not None:
                (self.frames_dir / depth_name(frame.frame_id, frame.drone)).write_bytes(encode_depth(frame.depth_mm))
        return pictures


class Agent(Protocol):
    """An agent that flies one episode. `dronecats.agent.loop.PaperAgent` is the agent of the paper."""

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began."""
        ...

    @property
    def steps(self) -> int:
        """Number of steps decided so far."""
        ...

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until `cap_s`, or until `stop` returns True for a new decision. Raises DronecatsError."""
        ...


AgentFactory = Callable[[Cockpit], Agent]
