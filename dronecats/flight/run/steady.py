"""The steady agent for a flight, asked and read as the paper's is."""

from functools import partial

from dronecats.agent.cockpit import AgentFactory
from dronecats.agent.models.model import Model
from dronecats.agent.steady.agent import SteadyAgent
from dronecats.flight.run.pilot import groups_of, questions_of
from dronecats.flight.spec.flight import Flight


def steady_agent(flight: Flight, model: Model) -> AgentFactory:
    """Return what makes the agent that bears a slow model: docs/steady.md."""
    return partial(SteadyAgent, questions_of(flight, model), groups=groups_of(flight))
