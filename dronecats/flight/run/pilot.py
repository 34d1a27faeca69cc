"""Opens the pilot of a flight, a model or a built-in pilot, and makes the agent that asks it for decisions."""

import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit
from dronecats.agent.commanding.command_prompt import CommandPrompt
from dronecats.agent.commanding.hierarchy import Hierarchy
from dronecats.agent.loop import PaperAgent, Questions
from dronecats.agent.models.model import Model
from dronecats.agent.models.replay import ReplayModel
from dronecats.agent.models.spec import ModelSpec
from dronecats.agent.models.wire_formats import open_model
from dronecats.agent.names import PAPER, STEADY
from dronecats.flight.processes.supervisor import ChildKind, Supervisor
from dronecats.flight.run.accounts import accounted
from dronecats.flight.spec.flight import Flight
from dronecats.flight.stages.stage import Stage
from dronecats.pilots import roster
from dronecats.pilots.server import PilotConfig, PilotServer
from foundation.errors import UsageError
from foundation.wording import suggestion

COMMANDER = ChildKind("commander", "dronecats.pilots.server:PilotPart", PilotConfig)
PILOT = ChildKind("pilot", "dronecats.pilots.server:PilotPart", PilotConfig)


def questions_of(flight: Flight, model: Model) -> Questions:
    """Return the model that a flight asks, and the settings of its questions."""
    spec = flight.spec
    served = spec.model is not None and spec.replay is None
    waits = spec.simulated is not None and spec.simulated.speed is None
    return Questions(
        model,
        flight.prompt,
        flight.instruction,
        spec.latency,
        axis_order=asker.axis_order if (asker := spec.model or spec.outside) else "xy",
        parser=spec.parser,
        patience_s=spec.patience_s,
        # In lockstep, vehicle time may advance during one call. With several calls at once, their order would vary.
        beside=served and waits and spec.command == "flat",
        last_reply=flight.scored,  # unscored flights do not wait for a late reply
    )


def papers_agent(flight: Flight, model: Model) -> AgentFactory:
    """Return the factory of the paper's agent. The agent asks one question for each group of drones."""
    return partial(PaperAgent, questions_of(flight, model), groups=groups_of(flight))


def steady_agent(flight: Flight, model: Model) -> AgentFactory:
    """Return the factory of the agent that tolerates a slow model: docs/steady.md."""
    from dronecats.agent.steady.agent import SteadyAgent  # here, because scipy.stats takes seconds to load

    return partial(SteadyAgent, questions_of(flight, model), groups=groups_of(flight))


def groups_of(flight: Flight) -> list[list[int]] | None:
    """Return the groups of drones that share one question; None: all drones are one group."""
    if flight.record is None or flight.spec.command != "solo":
        return None
    return [[drone] for drone in range(len(flight.record.starts))]


AgentMaker = Callable[[Flight, Model], AgentFactory]
SHIPPED: dict[str, AgentMaker] = {PAPER: papers_agent, STEADY: steady_agent}


def agent_maker(name: str) -> AgentMaker:
    """Return the maker of a shipped agent, or the maker that MODULE:NAME names. Raises UsageError."""
    if name in SHIPPED:
        return SHIPPED[name]
    module, colon, function = name.partition(":")
    try:
        maker = getattr(importlib.import_module(module), function) if colon else None
    except (ImportError, AttributeError, ValueError) as error:
        raise UsageError(f"--agent {name} cannot be loaded: {error}") from None
    if not callable(maker):
        hint = f"{suggestion(name, SHIPPED, cutoff=0.6)} Your own agent is MODULE:NAME (docs/extending.md)"
        raise UsageError(f"--agent '{name}' is not known: {hint}")
    made: AgentMaker = maker
    return made


@dataclass(frozen=True, slots=True)
class OpenPilot:
    """The opened model of a flight, and in a hierarchy the commander's model."""

    model: Model
    begin: Callable[[int], None] = lambda t0_us: None  # called when the episode begins, with the vehicle's time in µs
    check: Callable[[], None] = lambda: None  # raises InfrastructureError if the server of a built-in pilot is gone
    spent: Callable[[], str] = lambda: ""  # cost of the run so far, in words; empty: no cost
    commander: Model | None = None

    def agent(self, flight: Flight) -> AgentFactory:
        """Return the factory of the flight's agent. With a commander, a hierarchy replaces the paper's agent."""
        maker = agent_maker(flight.spec.agent)
        if self.commander is not None and maker is papers_agent:
            questions = questions_of(flight, self.model)
            make: AgentFactory = partial(Hierarchy, questions, self.commander, CommandPrompt.load())
        else:
            make = maker(flight, self.model)

        def begin(cockpit: Cockpit) -> Agent:
            self.begin(cockpit.t0_us)
            return make(cockpit)

        return begin


@contextmanager
def opened(flight: Flight, stage: Stage, folder: Path) -> Iterator[OpenPilot]:
    """Open a pilot that needs no true poses; its log is in `folder`. Raises UsageError, InfrastructureError."""
    with _piloted(flight, stage, folder) as pilot, commanded(flight, stage, folder, pilot) as pilot_ready:
        yield pilot_ready


@contextmanager
def _piloted(flight: Flight, stage: Stage, folder: Path) -> Iterator[OpenPilot]:
    spec = flight.spec
    if spec.replay:
        yield OpenPilot(ReplayModel(spec.replay))
    elif flight.outside is not None:
        yield OpenPilot(flight.outside)
    elif spec.model:
        with accounted(spec.model, spec.accounts, folder.parent) as (model, spent):
            yield OpenPilot(model, spent=spent)
    else:
        assert spec.pilot is not None  # a flight has a model or a built-in pilot
        with _served(spec.pilot, stage, folder) as pilot:
            yield pilot


@contextmanager
def commanded(flight: Flight, stage: Stage, folder: Path, pilot: OpenPilot) -> Iterator[OpenPilot]:
    """Open the flight's commander, if any; yield `pilot` with the commander. Raises UsageError, InfrastructureError."""
    spec = flight.spec
    if spec.command != "hierarchical":
        yield pilot
        return
    scripted = spec.scripted_commander
    if spec.replay:
        yield replace(pilot, commander=ReplayModel(spec.replay, "commander"))
        return
    if scripted is None and spec.commander is None:
        yield replace(pilot, commander=pilot.model)
        return

    with _served(scripted, stage, folder, COMMANDER) if scripted else _commander(flight, folder) as commander:

        def check() -> None:
            pilot.check()
            commander.check()

        yield replace(pilot, commander=commander.model, check=check, spent=lambda: pilot.spent() or commander.spent())


@contextmanager
def _commander(flight: Flight, folder: Path) -> Iterator[OpenPilot]:
    """Open the commander's model with the pilot's ledger, so that `spent` returns the cost of both models."""
    assert flight.spec.commander is not None
    with accounted(flight.spec.commander, flight.spec.accounts, folder.parent) as (model, spent):
        yield OpenPilot(model, spent=spent)


@contextmanager
def _served(name: str, stage: Stage, folder: Path, kind: ChildKind[PilotConfig] = PILOT) -> Iterator[OpenPilot]:
    """Serve a built-in pilot: in a thread if the clock waits for replies (lockstep), else in a separate process."""
    with ExitStack() as opened:
        check: Callable[[], None] = lambda: None  # noqa: E731  # a server thread needs no check
        if stage.speed is None:
            server = PilotServer(roster.answer(name), name, owned_by=roster.owner(name)).start()
            opened.callback(server.close)
            url = server.base_url
        else:
            supervisor = Supervisor(folder)
            opened.callback(supervisor.close)
            url, check = supervisor.start(kind, PilotConfig(pilot=name)).ready()["base_url"], supervisor.check
        model = open_model(ModelSpec(provider="local", name=name, base_url=url))
        opened.callback(model.close)
        yield OpenPilot(model, check=check)
