"""The pilot that a flight asks for, opened: a model, a built-in pilot that is served like one, or the oracle."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit
from dronecats.agent.decider import Questions
from dronecats.agent.loop import PaperAgent
from dronecats.agent.models.model import Model
from dronecats.agent.models.open import open_model
from dronecats.agent.models.replay import ReplayModel
from dronecats.agent.models.spec import ModelSpec
from dronecats.flight.flight import Flight
from dronecats.pilots import roster
from dronecats.pilots.config import PilotConfig
from dronecats.pilots.server import PilotServer
from dronecats.processes.supervisor import Supervisor
from dronecats.run.accounts import accounted
from dronecats.stages.parts import PILOT
from dronecats.stages.stage import Stage

AgentMaker = Callable[[Flight, Model], AgentFactory]


def papers_agent(flight: Flight, model: Model) -> AgentFactory:
    """Return what makes the paper's agent: one decider for all drones, which asks the model."""
    spec = flight.spec
    return partial(
        PaperAgent,
        Questions(
            model,
            flight.prompt,
            flight.instruction,
            flight.latency,
            axis_order=spec.model.axis_order if spec.model else "xy",
            parser=spec.parser,
            patience_s=spec.patience_s,
            last_reply=flight.scored,  # where nothing is scored, nothing is worth staying up for
        ),
    )


@dataclass(frozen=True, slots=True)
class OpenPilot:
    """A model that can be asked."""

    model: Model
    begin: Callable[[int], None] = lambda t0_us: None  # called when the episode begins, with the vehicle's time in µs
    check: Callable[[], None] = lambda: None  # raises InfrastructureError when what serves it is gone
    spent: Callable[[], str] = lambda: ""  # what the run has cost so far, in a few words; nothing where nobody is paid

    def agent(self, flight: Flight, maker: AgentMaker) -> AgentFactory:
        """Return what makes an agent of it."""
        make = maker(flight, self.model)

        def begin(cockpit: Cockpit) -> Agent:
            self.begin(cockpit.t0_us)
            return make(cockpit)

        return begin


@contextmanager
def opened(flight: Flight, stage: Stage, folder: Path) -> Iterator[OpenPilot]:
    """Open a pilot that needs no truth; `folder` takes its log. Raises UsageError, InfrastructureError."""
    spec = flight.spec
    if spec.replay:
        yield OpenPilot(ReplayModel(spec.replay))
    elif spec.model:
        with accounted(spec.model, spec.accounts, folder.parent) as asked:
            yield OpenPilot(asked.model, spent=asked.spent)
    else:
        assert spec.pilot is not None  # a flight has one of the two
        with _served(spec.pilot, stage, folder) as pilot:
            yield pilot


@contextmanager
def _endpoint(spec: ModelSpec) -> Iterator[OpenPilot]:
    model = open_model(spec)
    try:
        yield OpenPilot(model)
    finally:
        model.close()


@contextmanager
def _served(name: str, stage: Stage, folder: Path) -> Iterator[OpenPilot]:
    """Serve a built-in pilot: by a thread where the clock waits, and by a process of its own where it does not."""
    if stage.lockstep:
        server = PilotServer(roster.answer(name), name, owned_by=roster.owner(name)).start()
        try:
            with _endpoint(_local(name, server.base_url)) as pilot:
                yield pilot
        finally:
            server.close()
        return
    supervisor = Supervisor(folder)
    try:
        url = supervisor.start(PILOT, PilotConfig(pilot=name)).ready()["base_url"]
        with _endpoint(_local(name, url)) as pilot:
            yield OpenPilot(pilot.model, check=supervisor.check)
    finally:
        supervisor.close()


def _local(name: str, base_url: str) -> ModelSpec:
    return ModelSpec(provider="local", name=name, base_url=base_url)
