"""A commander with a pilot for each drone: what the paper's agent is made to support and leaves to future work.

Paper, "Organisational Settings". All fly side by side without a thread: the pilots each on their own clock of actions,
asked at once when they are due at once, and the commander beside them.
"""

from collections.abc import Callable

from dronecats.agent.cockpit import Cockpit
from dronecats.agent.commander import CommandQuestions, FleetCommander
from dronecats.agent.decider import Questions, Tally
from dronecats.agent.decisions import Decision
from dronecats.agent.drone import Drone
from dronecats.agent.loop import side_by_side
from dronecats.agent.roster import Post
from dronecats.agent.subordinate import Subordinate
from foundation.protocol import CAP_S
from foundation.run_folder.rows import Exchange
from foundation.run_folder.writing import LineLog


class Hierarchy:
    """Flies one episode. Everything it touches comes in through the constructor."""

    def __init__(self, questions: Questions, command: CommandQuestions, cockpit: Cockpit) -> None:
        """`questions` are those of the pilots, whose instruction holds for a drone until it has a goal."""
        self._cockpit = cockpit
        self._tally = Tally()
        self._log: LineLog | None = None
        self._drones = [Drone(i, each, cockpit.camera_model) for i, each in enumerate(cockpit.aircraft)]
        posts = [Post(drone, questions.instruction) for drone in self._drones]
        self._pilots = [Subordinate(questions, post, cockpit, lambda: self.now_s, self._tally) for post in posts]
        self._commander = FleetCommander(command, posts, cockpit, lambda: self.now_s, self._tally, self._keep)

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began, by the drone that has heard of the latest."""
        return (max(drone.aircraft.time_us for drone in self._drones) - self._cockpit.t0_us) / 1e6

    @property
    def steps(self) -> int:
        """How many steps were decided, the pilots' and the confirmations."""
        return self._tally.taken

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until the episode's time is over, or until `stop` says so of a decision just made."""
        if self._cockpit.commander_log is not None:
            self._log = LineLog(self._cockpit.commander_log)
        try:
            flights = [pilot.fly(cap_s, stop) for pilot in self._pilots]
            side_by_side([*flights, self._commander.fly(cap_s, stop)], self._tick)
        finally:
            if self._log is not None:
                self._log.close()

    def _keep(self, exchange: Exchange) -> None:
        if self._log is not None:
            self._log.write(exchange)

    def _tick(self) -> None:
        for drone in self._drones:
            drone.aircraft.tick()
        self._cockpit.on_tick()
