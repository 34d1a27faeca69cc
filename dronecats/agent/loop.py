"""The loop of the paper: see, decide, act, log. It knows a frame, an instruction, its history, and MAVLink."""

from collections.abc import Callable, Generator, Sequence
from typing import Generic, TypeVar

from dronecats.agent.aircraft import Aircraft
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.decider import Decider, Questions, Tally
from dronecats.agent.decisions import Decision
from dronecats.agent.drone import Drone
from foundation.camera import CameraModel
from foundation.protocol import CAP_S

D = TypeVar("D", bound=Drone)
DroneMaker = Callable[[int, Aircraft, CameraModel], D]  # of its index, what it flies and its camera
DeciderMaker = Callable[[Questions, Sequence[D], Cockpit, Callable[[], float], Tally], Decider]


class GroupedAgent(Generic[D]):
    """Flies one episode, each group of drones under a decider of its own; which drones and deciders, its kinds say.

    Everything it touches comes in through the constructor.
    """

    def __init__(
        self,
        questions: Questions,
        cockpit: Cockpit,
        groups: Sequence[Sequence[int]] | None,
        drone: DroneMaker[D],
        decider: DeciderMaker[D],
    ) -> None:
        """`groups` of drones that are decided for together, each on its own clock; None: all of them at once."""
        self._cockpit = cockpit
        self._drones = [drone(i, each, cockpit.camera_model) for i, each in enumerate(cockpit.aircraft)]
        tally = Tally()
        self._deciders = [
            decider(questions, [self._drones[i] for i in group], cockpit, lambda: self.now_s, tally)
            for group in groups or [range(len(self._drones))]
        ]

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began, by the drone that has heard of the latest: all boot at once."""
        return (max(drone.aircraft.time_us for drone in self._drones) - self._cockpit.t0_us) / 1e6

    @property
    def steps(self) -> int:
        """How many steps were decided, of all deciders."""
        return sum(decider.steps for decider in self._deciders)

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly steps until the episode's time is over, or until `stop` says so of a decision just made."""
        side_by_side([decider.fly(cap_s, stop) for decider in self._deciders], self._tick)

    def _tick(self) -> None:
        for drone in self._drones:
            drone.aircraft.tick()
        self._fly_on()
        self._cockpit.on_tick()

    def _fly_on(self) -> None:
        """Do what has to be done on every tick, whoever is asked meanwhile."""


class PaperAgent(GroupedAgent[Drone]):
    """The paper's: each drone flies one action to its end before the next picture; of a fleet its joint command."""

    def __init__(self, questions: Questions, cockpit: Cockpit, groups: Sequence[Sequence[int]] | None = None) -> None:
        super().__init__(questions, cockpit, groups, Drone, Decider)


def side_by_side(flights: Sequence[Generator[None, None, bool]], tick: Callable[[], None]) -> None:
    """Advance all of these from tick to tick, in their order, until one was told to stop or all are over."""
    under_way = list(flights)
    while True:
        for flight in list(under_way):
            try:
                next(flight)
            except StopIteration as over:
                if over.value:
                    return
                under_way.remove(flight)
        if not under_way:
            return
        tick()
