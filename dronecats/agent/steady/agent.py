"""The loop of the steady agent: the paper's, but that the drones fly on while their next picture is asked about."""

from collections.abc import Sequence

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.decider import Questions
from dronecats.agent.loop import GroupedAgent
from dronecats.agent.steady.decider import SteadyDecider
from dronecats.agent.steady.drone import SteadyDrone


class SteadyAgent(GroupedAgent[SteadyDrone]):
    """Flies one episode, every drone under one decider, or each group under its own, as `PaperAgent` does."""

    def __init__(self, questions: Questions, cockpit: Cockpit, groups: Sequence[Sequence[int]] | None = None) -> None:
        super().__init__(questions, cockpit, groups, SteadyDrone, SteadyDecider)

    def _fly_on(self) -> None:
        for drone in self._drones:
            drone.advance(self.now_s)
