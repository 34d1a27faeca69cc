"""The loop of the steady agent: the paper's, but that the drones fly on while their next picture is asked about."""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from statistics import median

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.loop import Decider, GroupedAgent, Questions, Tally
from dronecats.agent.model_call import Asking
from dronecats.agent.steady.drone import SteadyDrone
from foundation.camera import Frame
from foundation.run_folder.rows import Decision

REMEMBERED = 5  # replies by which the next one's time is told


class SteadyDecider(Decider):
    """One question at a time, as the paper's; but the next is asked while the last action is still flown."""

    def __init__(
        self,
        questions: Questions,
        drones: Sequence[SteadyDrone],
        cockpit: Cockpit,
        now_s: Callable[[], float],
        tally: Tally | None = None,
    ) -> None:
        super().__init__(questions, drones, cockpit, now_s, tally)
        self._steady = drones
        self._ages: deque[float] = deque(maxlen=REMEMBERED)  # s, of pictures when their replies were acted on

    @property
    def age_s(self) -> float:
        """How old a picture is when its reply is there, s of vehicle time: the median of the last ones."""
        return median(self._ages) if self._ages else 0.0

    def _decide(self, frames: Sequence[Frame], asking: Asking, thinking: bool) -> list[Decision]:
        self._ages.append(max(self._now_s() - self._since_begin_s(frame) for frame in frames))
        for drone in self._steady:
            drone.period_s = self.age_s
        return super()._decide(frames, asking, thinking)

    def _act(self, cap_s: float) -> Generator[None, None, None]:
        """Yield until it is time for the next picture. The drones fly on meanwhile, and while it is asked about."""
        while not all(drone.asks(self._now_s(), self.age_s) for drone in self._steady) and self._now_s() < cap_s:
            yield


class SteadyAgent(GroupedAgent[SteadyDrone]):
    """Flies one episode, every drone under one decider, or each group under its own, as `PaperAgent` does."""

    def __init__(self, questions: Questions, cockpit: Cockpit, groups: Sequence[Sequence[int]] | None = None) -> None:
        super().__init__(questions, cockpit, groups, SteadyDrone, SteadyDecider)

    def _fly_on(self) -> None:
        for drone in self._drones:
            drone.advance(self.now_s)
