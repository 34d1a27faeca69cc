"""What an agent is given to fly an episode with. All of it comes in here, and nothing else."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from dronecats.agent.drone import Aircraft
from dronecats.agent.host_pace import HostPace
from dronecats.agent.models.model import Request
from dronecats.agent.pictures import PicturePath
from foundation.camera import Camera, CameraModel, Frame
from foundation.protocol import CAP_S
from foundation.run_folder.rows import Decision
from foundation.run_folder.writing import LineLog, PromptLog


def _nothing(*_: object) -> None:
    """Take what nobody listens to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cockpit:
    """One episode's vehicles, eyes and log. Times of the episode count from `t0_us` on the vehicles' clock."""

    aircraft: Sequence[Aircraft]  # one per drone, in a fixed order
    camera: Camera
    camera_model: CameraModel
    log: LineLog
    frames_dir: Path
    executor: Executor  # where what may take long is called
    t0_us: int  # µs, the vehicles' clock when the episode began
    prompts: PromptLog | None = None  # logs the text of every question; None: prompts are not logged
    commander_log: Path | None = None  # where a hierarchy keeps its exchanges; None: nowhere
    seed: tuple[int, ...] = (0,)  # of all that an agent draws
    on_step: Callable[[Decision], None] = _nothing  # called with every decision
    on_tick: Callable[[], None] = _nothing  # called at every tick; what it raises ends the flight
    pictures: PicturePath | None = None  # what is done to pictures on purpose; None: each is had when it is taken
    host: HostPace | None = None  # what the vehicle's clock is held to; None: nothing, and no host can be late

    def log_prompt(self, request: Request, frames: Sequence[Frame], asked_s: float) -> None:
        """Log the text of a question that is about to be asked, `asked_s` after the episode began."""
        if self.prompts:
            ids = [frame.frame_id for frame in frames]
            self.prompts.write(request.role, request.drone, request.step, asked_s, ids, request.labels, request.text)


class Agent(Protocol):
    """Whoever flies. `dronecats.agent.loop.PaperAgent` is the paper's; another is one class more."""

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began."""
        ...

    @property
    def steps(self) -> int:
        """How many steps were decided."""
        ...

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until `cap_s`, or until `stop` says so of a decision just made. Raises DronecatsError."""
        ...


AgentFactory = Callable[[Cockpit], Agent]
