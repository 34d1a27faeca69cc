"""Agents by name: those that ship, and any of one's own. What makes one is loaded when it is wanted."""

import importlib
from collections.abc import Callable

from dronecats.agent.cockpit import AgentFactory
from dronecats.agent.models.model import Model
from dronecats.agent.names import PAPER, STEADY
from dronecats.flight.spec.flight import Flight
from foundation.errors import UsageError

AgentMaker = Callable[[Flight, Model], AgentFactory]

SHIPPED = {PAPER: "dronecats.flight.run.pilot:papers_agent", STEADY: "dronecats.flight.run.steady:steady_agent"}


def agent_maker(name: str) -> AgentMaker:
    """Return what makes the agent of a name, or of a MODULE:NAME. Raises UsageError when there is none."""
    module, colon, function = SHIPPED.get(name, name).partition(":")
    try:
        maker = getattr(importlib.import_module(module), function) if colon else None
    except (ImportError, AttributeError, ValueError) as error:
        raise UsageError(f"--agent {name} cannot be loaded: {error}") from None
    if not callable(maker):
        known = ", ".join(SHIPPED)
        raise UsageError(f"--agent wants {known} or MODULE:NAME of a function (docs/extending.md), got '{name}'")
    made: AgentMaker = maker
    return made
