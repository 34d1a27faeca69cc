"""The sequence of every flight, from its record to its judged folder. Each kind of vehicle is a subclass."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dronecats.agent.cockpit import AgentFactory
from dronecats.agent.models.model import Model
from dronecats.agent.pictures import PicturePath
from dronecats.flight.run.ascent import StartOffset
from dronecats.flight.run.episode import EVERYTHING, Flown, StartCheck, fly
from dronecats.flight.run.outcome import Say, fly_and_judge
from dronecats.flight.run.pilot import OpenPilot
from dronecats.flight.run.step_lines import StepLines
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Authority
from dronecats.flight.stages.stage import Stage
from hil.cameras.open import PatientCamera
from hil.link.link import Link


class Instruments:
    """Watches what a connected vehicle is flown with. This one watches nothing; a measurement is a subclass."""

    def watch(self, link: Link, camera: PatientCamera, run: Path) -> None:
        """Begin to watch link and camera, before the first message is sent. `run` is the run folder."""

    def model(self, model: Model) -> Model:
        """Return the model that the agent asks."""
        return model

    def agent(self, make: AgentFactory) -> AgentFactory:
        """Return what makes the agent."""
        return make


UNWATCHED = Instruments()


@dataclass(frozen=True, slots=True, kw_only=True)
class Ready:
    """Everything that an episode needs, started."""

    stage: Stage
    starts: list[StartOffset]  # of each drone
    pilot: OpenPilot
    true_start: StartCheck | None = None  # decides whether the episode may begin; None: it may
    pictures: PicturePath | None = None  # what is done to pictures on purpose; None: nothing


class FlightSetup(ABC):
    """A flight that has been looked up and checked. Each kind of vehicle is a subclass."""

    authority: Authority = EVERYTHING
    headline = ""  # printed before the flight; empty: nothing is

    def __init__(self, flight: Flight, episode: str, camera: dict[str, Any] | None) -> None:
        """`episode` names its folder; `camera` is what run.json says of the camera."""
        self.flight, self.episode, self.camera = flight, episode, camera
        self.pace: dict[str, float] | None = None  # how well a flight in real time held it, known after the flight

    @abstractmethod
    def write_record(self, folder: Path) -> None:
        """Write episode.json. Raises InfrastructureError."""

    @abstractmethod
    def ready(self, folder: Path, say: Say) -> AbstractContextManager[Ready]:
        """Start everything that the episode needs, and end it afterwards. Raises UsageError, InfrastructureError."""

    def agent(self, pilot: OpenPilot) -> AgentFactory:
        """Return what makes the agent that flies."""
        return pilot.agent(self.flight)

    def facts(self) -> dict[str, Any]:
        """Return what run.json says that only the flight could tell."""
        return {} if self.pace is None else {"pace": self.pace}

    @abstractmethod
    def finish(self, folder: Path, flown: Flown, say: Say) -> None:
        """Write the pictures and logs that a judged folder has besides."""

    def fly_in(
        self, folder: Path, say: Say, afterwards: Callable[[Flown], None] = lambda flown: None
    ) -> dict[str, Any]:
        """Fly in an episode folder that exists, judge it, and return what `fly --json` prints.

        `afterwards` is called once the verdict is written. Raises InfrastructureError.
        """
        self.write_record(folder)
        spec = self.flight.spec

        def flight() -> Flown:
            with self.ready(folder, say) as ready:
                return fly(
                    ready.stage, ready.starts, self.agent(ready.pilot), folder,
                    seed=self.flight.seed, full=spec.full, cap_s=spec.seconds, authority=self.authority,
                    pictures=ready.pictures, check=ready.pilot.check, say=say, true_start=ready.true_start,
                    on_step=StepLines(say, len(ready.starts), ready.pilot.spent, spec.stop_unreadable),
                )  # fmt: skip

        return fly_and_judge(flight, folder, self.episode, spec.pilot_name, afterwards, pace=lambda: self.pace)
