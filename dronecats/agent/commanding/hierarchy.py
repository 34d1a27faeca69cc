"""A commander model directs the pilots of a fleet. The paper ("Organisational Settings") leaves this to future work."""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace

from msgspec import UNSET

from dronecats.agent.action import Action, ActionError, Finished
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.commanding.command_prompt import (
    INTERVAL_S,
    STALL_STEPS,
    CommandedDrone,
    CommandPrompt,
    FleetOrders,
    parse_orders,
    roster,
)
from dronecats.agent.latency import COMMANDER
from dronecats.agent.loop import Asker, Decider, PendingQuestion, Questions, SideBySideAgent, Tally
from dronecats.agent.models.model import Model
from dronecats.agent.prompt import History
from foundation.camera import Frame
from foundation.errors import ModelError
from foundation.protocol import CAP_S, GO
from foundation.run_folder.rows import Cause, Decision, Exchange, Order
from foundation.run_folder.writing import LineLog


@dataclass(frozen=True, slots=True)
class _Shown:
    """The state that one question shows to the commander."""

    number: int
    sent_s: float
    causes: tuple[Cause, ...]
    frames: tuple[Frame, ...]  # one per drone
    roster: str
    reports: frozenset[int]  # drones with a report that the commander has not yet answered


class FleetCommander(Asker):
    """The commander of a fleet: one model for all drones. It is asked after events and at intervals, not every step.

    The commander sees the picture of every camera, and the roster (the state of each drone as text). It gives goals.
    Only the commander declares arrival: a pilot's report becomes a declaration when the commander confirms it. The
    declaration has the id and time of the picture of this pilot's drone that the commander saw.
    """

    def __init__(
        self,
        questions: Questions,
        prompt: CommandPrompt,
        posts: Sequence[CommandedDrone],
        cockpit: Cockpit,
        now_s: Callable[[], float],
        tally: Tally,
        keep: Callable[[Exchange], None],
    ) -> None:
        """`questions`: the settings of the commander's questions, except their prompt, which is `prompt`.

        `posts`: the states of drones 0, 1, 2 …. `tally` numbers the decisions. `keep` logs a question and its reply.
        """
        super().__init__(questions, cockpit, now_s, tally)
        self._prompt, self._posts, self._keep = prompt, posts, keep
        self._sent_s = 0.0  # time of the last question
        self._sent_reports: set[int] = set()  # drones whose open report has already been in a question

    def _causes(self) -> tuple[Cause, ...]:
        """Return the new causes for a question. Each report is a cause only once."""
        if not self._questions_sent:
            return (Cause(why="start"),)
        causes: list[Cause] = []
        for drone, post in enumerate(self._posts):
            if post.reported_s is None:
                self._sent_reports.discard(drone)
            elif drone not in self._sent_reports:
                causes.append(Cause(why="report", drone=drone))
            if post.steps_without_go >= STALL_STEPS and not post.waits:
                causes.append(Cause(why="stall", drone=drone))
        if not causes and self._now_s() >= self._sent_s + INTERVAL_S:
            causes.append(Cause(why="time"))
        return tuple(causes)

    def _turn(self, cap_s: float) -> Generator[None, None, Sequence[Decision]]:
        """Ask if there is a `Cause`, and carry out the orders. Raises ModelError, CameraError."""
        causes = self._causes()
        if not causes:
            yield
            return []
        frames = yield from self._newest_frames(COMMANDER, range(len(self._posts)), cap_s)
        if frames is None:
            return []
        causes = self._causes() or causes  # `_show` marks reports that arrived with the pictures as sent, so they count
        shown = self._show(causes, tuple(frames))
        text = self._prompt.render(self._questions.instruction, shown.roster, causes, len(self._posts))
        asking = self._ask(text, frames, shown.sent_s, role="commander")
        if not (yield from self._await(asking, cap_s)):
            if not (shown.number or asking.answered):
                raise ModelError("the commander sent no reply before the end of the episode")
            self._keep(self._row(shown, None, FleetOrders(), "the episode was over before the reply"))
            return []
        reply, now_s = asking.reply(), self._now_s()
        self._answered_s = now_s
        error: str | None = None
        try:
            orders, refusals = self._executable_orders(parse_orders(reply.text, len(self._posts)), shown)
            error = "; ".join(refusals) or None
        except ActionError as unreadable:
            orders, error = FleetOrders(), str(unreadable)
        self._keep(self._row(shown, asking, orders, error))
        decisions = [self._declare(drone, shown, asking) for drone in orders.confirmed]
        for drone, goal in orders.goals:
            self._posts[drone].order(goal, now_s)
        for post in self._posts:  # even after an unreadable reply, so that no drone waits for ever
            if not post.begun:
                post.begun, post.since_s = True, now_s
        return decisions

    def _show(self, causes: tuple[Cause, ...], frames: tuple[Frame, ...]) -> _Shown:
        now_s = max(self._now_s(), *map(self._since_begin_s, frames))
        reports = frozenset(drone for drone, post in enumerate(self._posts) if post.reported_s is not None)
        self._sent_s, self._sent_reports = now_s, set(reports)
        shown = _Shown(self._questions_sent, now_s, causes, frames, roster(self._posts, now_s), reports)
        for post in self._posts:
            if post.steps_without_go >= STALL_STEPS:
                post.steps_without_go = 0
        return shown

    def _executable_orders(self, orders: FleetOrders, shown: _Shown) -> tuple[FleetOrders, list[str]]:
        """Return the orders that can be carried out, and the reason for each refused order."""
        refusals: list[str] = []
        goals, confirmed = [], []
        for drone in orders.confirmed:
            if drone in shown.reports:
                confirmed.append(drone)
            else:
                refusals.append(f"drone {drone + 1} had no report to confirm")
        for drone, goal in orders.goals:
            if self._posts[drone].reported_s is None or drone in shown.reports:
                goals.append((drone, goal))
            else:
                refusals.append(f"drone {drone + 1} has reported meanwhile")
        return FleetOrders(tuple(goals), tuple(confirmed)), refusals

    def _declare(self, drone: int, shown: _Shown, asking: PendingQuestion) -> Decision:
        """Declare arrival at the frame that the commander saw. The drone has hovered since its report."""
        post, frame, now_s = self._posts[drone], shown.frames[drone], self._now_s()
        post.reported_s, post.confirmed = None, True
        decision = Decision(
            step=self._tally.take(),
            drone=drone,
            frame_id=frame.frame_id,
            t_frame=round(self._since_begin_s(frame), 6),
            t_decided=round(now_s, 6),
            action=Finished().as_json(),
            latency_s=round(asking.latency_s(now_s), 6),
            thinking=False,
            confirmed_by=shown.number,
        )
        self._cockpit.log.write(decision)
        self._cockpit.on_step(decision)
        return decision

    def _row(self, shown: _Shown, asking: PendingQuestion | None, orders: FleetOrders, error: str | None) -> Exchange:
        """Return the log row of an exchange; `asking` is None if the reply came too late."""
        reply, now_s = asking.reply() if asking else None, self._now_s()
        return Exchange(
            number=shown.number,
            t_asked=round(shown.sent_s, 6),
            t_answered=round(now_s, 6) if asking else None,
            causes=shown.causes,
            roster=shown.roster,
            frames=tuple(frame.frame_id for frame in shown.frames),
            reply=reply.text if reply else None,
            orders=tuple(Order(drone=drone, goal=goal) for drone, goal in orders.goals),
            confirms=orders.confirmed,
            error=error,
            latency_s=round(asking.latency_s(now_s), 6) if asking else None,
            tokens_in=reply.tokens_in if reply else None,
            tokens_out=reply.tokens_out if reply else None,
            model=self._questions.model.name,
            served=self._served_anew(reply) if reply else UNSET,
        )


class Subordinate(Decider):
    """A pilot under a commander. It has its own history and pace. A new goal clears its history."""

    def __init__(
        self, questions: Questions, post: CommandedDrone, cockpit: Cockpit, now_s: Callable[[], float], tally: Tally
    ) -> None:
        """`post` holds the commander's goals and the pilot's reports."""
        super().__init__(questions, [post.drone], cockpit, now_s, tally)
        self._post = post
        self._goal = post.goal  # goal of the current question

    def _turn(self, cap_s: float) -> Generator[None, None, Sequence[Decision]]:
        """Fly to the goal; hover while the drone waits for an order."""
        if self._post.waits:
            yield
            return []
        return (yield from super()._turn(cap_s))

    def _see(self, cap_s: float) -> Generator[None, None, list[Frame] | None]:
        """Return the newest frame, and adopt the present goal. A new goal clears the history."""
        frames = yield from super()._see(cap_s)
        drone = self._post.drone
        if self._post.goal != self._goal:
            self._goal = self._post.goal
            drone.history, drone.thinks_next = History(drone.history.camera), False
        return frames

    def _instruction(self) -> str:
        return self._goal

    def _report(self, action: Action | None) -> bool:
        return isinstance(action, Finished)

    def _decide(self, frames: Sequence[Frame], asking: PendingQuestion, thinking: bool, now_s: float) -> list[Decision]:
        decisions = super()._decide(frames, asking, thinking, now_s)
        if self._goal == self._post.goal:  # else the commander has changed the goal meanwhile
            for decision in decisions:
                self._post.note(decision.kind == GO, decision.report is True, self._now_s())
        return decisions


class Hierarchy(SideBySideAgent):
    """Flies one episode with a commander and its pilots. All run concurrently, and each pilot has its own pace."""

    def __init__(self, questions: Questions, commander: Model, prompt: CommandPrompt, cockpit: Cockpit) -> None:
        """`questions`: the settings of the pilots' questions. Their instruction is the first goal of every drone.

        `commander` and `prompt`: the commander's model and prompt. The commander's other settings are in `questions`.
        """
        super().__init__(cockpit)
        self._log: LineLog | None = None
        posts = [CommandedDrone(drone, questions.instruction) for drone in self._drones]
        self._deciders = [Subordinate(questions, post, cockpit, lambda: self.now_s, self._tally) for post in posts]
        self._commander = FleetCommander(
            replace(questions, model=commander, beside=False),
            prompt,
            posts,
            cockpit,
            lambda: self.now_s,
            self._tally,
            self._keep,
        )

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until the episode's time is over, or until `stop` returns True for a new decision."""
        path = self._cockpit.commander_log
        with closing(LineLog(path)) if path else nullcontext() as self._log:
            flights = [pilot.fly(cap_s, stop) for pilot in self._deciders]
            self._run([*flights, self._commander.fly(cap_s, stop)])

    def _keep(self, exchange: Exchange) -> None:
        if self._log is not None:
            self._log.write(exchange)
