"""One drone's pilot under a commander: the paper's, whose command is its goal, and whose arrival is a report."""

from collections.abc import Callable, Generator, Sequence

from dronecats.agent.action import Action, Finished
from dronecats.agent.asking import Asking
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.decider import Decider, Questions, Tally
from dronecats.agent.decisions import Decision
from dronecats.agent.history import History
from dronecats.agent.roster import Post
from foundation.camera import Frame
from foundation.protocol import GO


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
