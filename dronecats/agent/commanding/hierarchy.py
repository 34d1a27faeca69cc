"""A commander with a pilot for each drone: what the paper's agent is made to support and leaves to future work.

Paper, "Organisational Settings". All fly side by side without a thread: the pilots each on their own clock of actions,
asked at once when they are due at once, and the commander beside them.
"""

from collections.abc import Callable, Generator, Sequence

from dronecats.agent.action import Action, Finished
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.commanding.command_prompt import Post
from dronecats.agent.commanding.commander import CommandQuestions, FleetCommander
from dronecats.agent.drone import Drone
from dronecats.agent.history import History
from dronecats.agent.loop import Decider, Questions, Tally, side_by_side
from dronecats.agent.model_call import Asking
from foundation.camera import Frame
from foundation.protocol import CAP_S, GO
from foundation.run_folder.rows import Decision, Exchange
from foundation.run_folder.writing import LineLog


class Subordinate(Decider):
    """Same prompt, same four actions, a history and a pace of its own. A new goal is a new context."""

    def __init__(
        self, questions: Questions, post: Post, cockpit: Cockpit, now_s: Callable[[], float], tally: Tally
    ) -> None:
        """`post` is where the commander's goals come in and reports go out."""
        super().__init__(questions, [post.drone], cockpit, now_s, tally)
        self._post = post
        self._goal = post.goal  # under which the question under way was asked

    def fly(self, cap_s: float, stop: Callable[[Decision], bool]) -> Generator[None, None, bool]:
        """Fly the goals that come; hover while there is none to fly. As `Decider.fly`."""
        while self._now_s() < cap_s:
            if self._post.waits:
                yield
                continue
            self._take_up()
            frames = yield from self._see(cap_s)
            if frames is None:
                break
            self._take_up()  # one that came while the picture did
            decisions = yield from self._step(frames, cap_s)
            if any(stop(decision) for decision in decisions):
                return True
        return False

    def _take_up(self) -> None:
        """Go by the goal as it is now; what was done for another one is no part of it."""
        drone = self._post.drone
        if self._post.goal != self._goal:
            self._goal = self._post.goal
            drone.history, drone.thinks_next = History(drone.history.camera), False

    def _instruction(self) -> str:
        return self._goal

    def _report(self, action: Action | None) -> bool:
        return isinstance(action, Finished)

    def _decide(self, frames: Sequence[Frame], asking: Asking, thinking: bool) -> list[Decision]:
        decisions = super()._decide(frames, asking, thinking)
        if self._goal == self._post.goal:  # else the commander has changed its mind meanwhile
            for decision in decisions:
                self._post.note(decision.kind == GO, decision.report is True, self._now_s())
        return decisions


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
