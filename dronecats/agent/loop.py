"""The loop of the paper: see, decide, act, log. It knows a frame, an instruction, its history, and MAVLink."""

from collections.abc import Callable, Generator, Sequence

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.decider import Decider, Questions, Tally
from dronecats.agent.decisions import Decision
from dronecats.agent.drone import Drone
from foundation.protocol import CAP_S


class PaperAgent:
    """Flies one episode, every drone under one decider; of a fleet that is the paper's joint command.

    Everything it touches comes in through the constructor.
    """

    def __init__(self, questions: Questions, cockpit: Cockpit, groups: Sequence[Sequence[int]] | None = None) -> None:
        """`groups` of drones that are decided for together, each on its own clock; None: all of them at once."""
        self._cockpit = cockpit
        self._drones = [Drone(i, each, cockpit.camera_model) for i, each in enumerate(cockpit.aircraft)]
        tally = Tally()
        self._deciders = [
            Decider(questions, [self._drones[i] for i in group], cockpit, lambda: self.now_s, tally)
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
        self._cockpit.on_tick()


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
