"""What may be put between an agent and what it flies with, to measure it: nothing of the flight changes."""

from pathlib import Path

from dronecats.agent.cockpit import AgentFactory
from dronecats.agent.models.model import Model
from hil.cameras.patient import PatientCamera
from hil.link.link import Link


class Instruments:
    """None: everything is as it is. Whoever measures hands back the same, watched."""

    def watch(self, link: Link, camera: PatientCamera, run: Path) -> None:
        """Take in what the flight stands on, before anything is asked of it. `run` is the run folder."""

    def model(self, model: Model) -> Model:
        """Return the model that the agent asks."""
        return model

    def agent(self, make: AgentFactory) -> AgentFactory:
        """Return what makes the agent."""
        return make


UNWATCHED = Instruments()
