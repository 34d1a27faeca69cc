"""Runs a flight: writes the episode record, flies, and writes the verdict into the flight's folder."""

import signal
import statistics
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

from dronecats.agent.cockpit import AgentFactory
from dronecats.agent.models.model import Model
from dronecats.flight.run.episode import EpisodeEnd, Ready, fly
from dronecats.flight.run.identity import write_identity
from dronecats.flight.run.landing import signals_handled, unexpected
from dronecats.flight.run.pilot import OpenPilot
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Authority
from dronecats.judge.episode import verdict_of, write_verdict
from dronecats.judge.verdict import Measures
from foundation.errors import BudgetError, DronecatsError, InfrastructureError, UsageError
from foundation.extras import missing_package
from foundation.files import file_errors_as
from foundation.run_folder.layout import DECISIONS
from foundation.run_folder.reading import rows
from foundation.run_folder.results import Result
from foundation.run_folder.rows import Decision
from hil.cameras.open import PatientCamera
from hil.link.link import Link

Notify = Callable[[str], None]
Written = TypeVar("Written")


def fly_and_judge(
    flight: Callable[[], EpisodeEnd],
    folder: Path,
    episode: str,
    pilot_name: str,
    afterwards: Callable[[EpisodeEnd], None] = lambda ending: None,
    pace: Callable[[], Mapping[str, float] | None] = lambda: None,
) -> dict[str, Any]:
    """Fly, write a verdict in every case, and return the JSON object of `fly --json`.

    `afterwards` writes the other files of the flight. Ctrl-C is ignored while these files and the verdict are written.
    `pace` is called after the flight and returns how well the flight kept real time.
    """
    try:
        ending = flight()
    except KeyboardInterrupt:
        ending = EpisodeEnd("interrupted", None, 0.0, 0.0, 0)
    except BudgetError as spent:
        ending = EpisodeEnd("budget", spent, 0.0, 0.0, 0)
    except DronecatsError as error:
        ending = EpisodeEnd("error", error, 0.0, 0.0, 0)
    except ImportError as missing:
        sentence = missing_package(missing)
        ending = EpisodeEnd("error", UsageError(sentence) if sentence else unexpected(missing, folder), 0.0, 0.0, 0)
    except Exception as bug:
        ending = EpisodeEnd("error", unexpected(bug, folder), 0.0, 0.0, 0)
    with signals_handled(signal.SIG_IGN):
        # before the verdict, so that every folder with a verdict has identity.json too
        _, identity_error = _try_write(lambda: write_identity(folder, pace()), folder)
        verdict, verdict_error = _try_write(lambda: write_verdict(folder), folder)
        _, files_error = _try_write(lambda: afterwards(ending), folder)
    verdict = verdict or verdict_of(folder)
    if fault := ending.error or verdict_error or identity_error or files_error:
        ending = replace(ending, error=fault)
    status = {"cap": 0, "decided": 0, "interrupted": 130}.get(ending.reason, 3)
    if ending.error:
        status = ending.error.exit_status
    elif status == 0 and verdict.outcome == "error":
        status = 3
    result = Result(
        episode=episode,
        pilot=pilot_name,
        outcome=verdict.outcome,
        success=verdict.success,
        ne_m=verdict.ne_m,
        steps=ending.steps,
        declarations=verdict.declarations,
        **{field.name: getattr(verdict, field.name) for field in fields(Measures)},
        censored=verdict.censored,
        sim_seconds=round(ending.sim_seconds, 3),
        wall_seconds=round(ending.wall_seconds, 3),
        real_time_factor=round(ending.sim_seconds / ending.wall_seconds, 3) if ending.wall_seconds else 0.0,
        run_dir=str(folder),
        error=str(ending.error) if ending.error else verdict.error if ending.reason != "interrupted" else None,
        reason=ending.reason,
        status=status,
        host_stalls=verdict.host_stalls,
    )
    return result.as_json()


def _try_write(write: Callable[[], Written], folder: Path) -> tuple[Written | None, DronecatsError | None]:
    """Write a file after the flight; return the result of `write` and no error, or None and the error."""
    try:
        return write(), None
    except InfrastructureError as fault:
        return None, fault
    except OSError as fault:
        return None, unexpected(fault, folder)


def served_rate_hz(folder: Path) -> float | None:
    """Return the median rate of the decisions, per second of vehicle time; None if no decision has a rate."""
    rates = [d.rate_hz for d in rows(folder / DECISIONS, Decision) if d.rate_hz]
    return statistics.median(rates) if rates else None


class Instruments:
    """Watches link, camera, model and agent of a connected vehicle. The base class does nothing; subclasses measure."""

    def watch(self, link: Link, camera: PatientCamera, run: Path) -> None:
        """Start to watch link and camera. Called before the first message is sent. `run` is the run folder."""

    def model(self, model: Model) -> Model:
        """Return the model for the agent: `model`, or a wrapper that measures it."""
        return model

    def agent(self, make: AgentFactory) -> AgentFactory:
        """Return the factory of the agent: `make`, or a factory of measured agents."""
        return make


UNWATCHED = Instruments()


class FlightSetup(ABC):
    """A flight whose settings have been resolved and checked. Each kind of vehicle has a subclass."""

    authority = Authority()
    headline = ""  # printed before the flight, unless empty

    def __init__(self, flight: Flight, episode: str, camera: dict[str, Any] | None) -> None:
        """`episode` is the name of the episode's folder; `camera` is the camera's entry in run.json."""
        self.flight, self.episode, self.camera = flight, episode, camera
        self.pace: dict[str, float] | None = None  # how well the flight kept real time; set after the flight

    @abstractmethod
    def write_record(self, folder: Path) -> None:
        """Write episode.json. Raises OSError."""

    @abstractmethod
    def ready(self, folder: Path, notify: Notify) -> AbstractContextManager[Ready]:
        """Start everything that the episode needs, and end it afterwards. Raises UsageError, InfrastructureError."""

    def agent(self, pilot: OpenPilot) -> AgentFactory:
        return pilot.agent(self.flight)

    def facts(self) -> dict[str, Any]:
        """Return the entries of run.json that are known only after the flight."""
        return {} if self.pace is None else {"pace": self.pace}

    @abstractmethod
    def finish(self, folder: Path, ending: EpisodeEnd, notify: Notify) -> None:
        """Write the pictures and logs that are made after the verdict."""

    def fly_in(
        self, folder: Path, notify: Notify, afterwards: Callable[[EpisodeEnd], None] = lambda ending: None
    ) -> dict[str, Any]:
        """Fly into an existing folder, judge the flight, and return the object of `fly --json`.

        `afterwards` is called after the verdict is written. Raises InfrastructureError.
        """
        with file_errors_as(InfrastructureError, f"{folder} cannot be written"):
            self.write_record(folder)

        def flight() -> EpisodeEnd:
            with self.ready(folder, notify) as ready:
                return fly(self.flight, ready, self.agent(ready.pilot), self.authority, folder, notify)

        name = self.flight.spec.pilot_name
        return fly_and_judge(flight, folder, self.episode, name, afterwards, pace=lambda: self.pace)
