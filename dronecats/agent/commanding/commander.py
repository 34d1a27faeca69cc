"""Who commands the pilots of a fleet: asked when something has happened, and not every step.

It sees what every camera sees, and the roster; it gives goals, and it alone declares: what a pilot reports becomes a
declaration of the episode when the commander confirms it, on the picture that the commander saw of that drone.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from msgspec import UNSET, UnsetType

from dronecats.agent.action import Finished
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.commanding.command_prompt import INTERVAL_S, STALL_STEPS, CommandPrompt, Post, roster
from dronecats.agent.commanding.orders import FleetOrders, OrdersError, parse_orders
from dronecats.agent.latency import COMMANDER, LatencyPolicy, Question
from dronecats.agent.loop import Tally, keep_pictures, newest_frames
from dronecats.agent.model_call import Asking, await_reply
from dronecats.agent.models.model import Model, Request
from dronecats.agent.prompt import labels
from foundation.camera import Frame
from foundation.errors import ModelError
from foundation.run_folder.rows import Cause, Decision, Exchange, Order


@dataclass(frozen=True, slots=True)
class CommandQuestions:
    """Whom a fleet's commander is, and how it is asked."""

    model: Model
    prompt: CommandPrompt
    instruction: str  # the episode's
    latency: LatencyPolicy
    patience_s: float | None = None  # as `Questions` has them
    last_reply: bool = True


@dataclass(frozen=True, slots=True)
class _Shown:
    """What the commander has before it while it thinks."""

    number: int
    asked_s: float
    causes: tuple[Cause, ...]
    frames: tuple[Frame, ...]  # one per drone
    roster: str
    reports: frozenset[int]  # drones whose report is open


class FleetCommander:
    """One context for all drones."""

    def __init__(
        self,
        command: CommandQuestions,
        posts: Sequence[Post],
        cockpit: Cockpit,
        now_s: Callable[[], float],
        tally: Tally,
        keep: Callable[[Exchange], None],
    ) -> None:
        """`posts` are the drones' in their order, `keep` takes what has to be logged."""
        self._command, self._posts, self._cockpit = command, posts, cockpit
        self._now_s, self._tally, self._keep = now_s, tally, keep
        self._asked = 0
        self._asked_s = 0.0  # when it was asked last
        self._answered_s: float | None = None  # when it answered last
        self._served: str | None = None  # what answered last, in the vendor's words
        self._told: set[int] = set()  # drones whose open report it has been asked about

    def fly(self, cap_s: float, stop: Callable[[Decision], bool]) -> Generator[None, None, bool]:
        """Ask whenever there is a cause, and carry out what it says, until `cap_s` or until `stop` says so.

        As `Decider.fly`. Raises ModelError, CameraError.
        """
        while self._now_s() < cap_s:
            causes = self._causes()
            if not causes:
                yield
                continue
            decisions = yield from self._exchange(causes, cap_s)
            if any(stop(decision) for decision in decisions):
                return True
        return False

    def _causes(self) -> tuple[Cause, ...]:
        """Return what there is to ask about; of what is told once, nothing twice."""
        if not self._asked:
            return (Cause(why="start"),)
        found: list[Cause] = []
        for drone, post in enumerate(self._posts):
            if post.reported_s is None:
                self._told.discard(drone)
            elif drone not in self._told:
                found.append(Cause(why="report", drone=drone))
            if post.still >= STALL_STEPS and not post.waits:
                found.append(Cause(why="stall", drone=drone))
        if not found and self._now_s() >= self._asked_s + INTERVAL_S:
            found.append(Cause(why="time"))
        return tuple(found)

    def _exchange(self, causes: tuple[Cause, ...], cap_s: float) -> Generator[None, None, list[Decision]]:
        command = self._command
        question = Question(self._cockpit.seed, self._asked, COMMANDER)
        frames = yield from newest_frames(
            self._cockpit, question, range(len(self._posts)), self._now_s, cap_s, command.patience_s
        )
        if frames is None:
            return []
        shown = self._show(causes, tuple(frames))
        asking = self._ask(shown)
        due = yield from await_reply(asking, self._now_s, shown.asked_s, cap_s, command.patience_s, command.last_reply)
        if not due:
            if asking.answered and not self._tally.taken and not shown.number:
                raise ModelError("the commander did not answer once before the episode was over")
            self._keep(self._row(shown, None, FleetOrders(), "the episode was over before the reply"))
            return []
        reply, now_s = asking.reply(), self._now_s()
        self._answered_s = now_s
        error: str | None = None
        try:
            orders, refused = self._granted(parse_orders(reply.text, len(self._posts)), shown)
            error = "; ".join(refused) or None
        except OrdersError as unreadable:
            orders, error = FleetOrders(), str(unreadable)
        self._keep(self._row(shown, asking, orders, error))
        decisions = [self._declare(drone, shown, asking) for drone in orders.confirmed]
        for drone, goal in orders.goals:
            self._posts[drone].order(goal, now_s)
        for post in self._posts:  # whatever it said: a commander who cannot be read keeps nobody on the spot
            if not post.begun:
                post.begun, post.since_s = True, now_s
        return decisions

    def _show(self, causes: tuple[Cause, ...], frames: tuple[Frame, ...]) -> _Shown:
        now_s = max(self._now_s(), *((frame.time_us - self._cockpit.t0_us) / 1e6 for frame in frames))
        reports = frozenset(drone for drone, post in enumerate(self._posts) if post.reported_s is not None)
        shown = _Shown(self._asked, now_s, causes, frames, roster(self._posts, now_s), reports)
        self._asked, self._asked_s, self._told = self._asked + 1, now_s, set(reports)
        for post in self._posts:
            if post.still >= STALL_STEPS:
                post.still = 0
        return shown

    def _ask(self, shown: _Shown) -> Asking:
        command, drones = self._command, len(self._posts)
        request = Request(
            command.prompt.render(command.instruction, shown.roster, shown.causes, drones),
            keep_pictures(self._cockpit, shown.frames),
            thinking=False,
            labels=labels(drones),
            step=shown.number,
            role="commander",
        )
        self._cockpit.log_prompt(request, shown.frames, shown.asked_s)
        question = Question(self._cockpit.seed, shown.number, COMMANDER)
        executor, last_s = self._cockpit.executor, self._answered_s
        return Asking(command.model, request, executor, command.latency, question, shown.asked_s, last_s=last_s)

    def _granted(self, orders: FleetOrders, shown: _Shown) -> tuple[FleetOrders, list[str]]:
        """Return what of the orders can be carried out, and why the rest cannot: it acts on what it was shown."""
        refused: list[str] = []
        goals, confirmed = [], []
        for drone in orders.confirmed:
            if drone in shown.reports:
                confirmed.append(drone)
            else:
                refused.append(f"drone {drone + 1} had no report to confirm")
        for drone, goal in orders.goals:
            if self._posts[drone].reported_s is None or drone in shown.reports:
                goals.append((drone, goal))
            else:
                refused.append(f"drone {drone + 1} has reported meanwhile")
        return FleetOrders(tuple(goals), tuple(confirmed)), refused

    def _declare(self, drone: int, shown: _Shown, asking: Asking) -> Decision:
        """Declare a confirmed report: on the frame that the commander saw, which the drone has hovered at since."""
        post, frame, now_s = self._posts[drone], shown.frames[drone], self._now_s()
        post.reported_s, post.confirmed = None, True
        decision = Decision(
            step=self._tally.take(),
            drone=drone,
            frame_id=frame.frame_id,
            t_frame=round((frame.time_us - self._cockpit.t0_us) / 1e6, 6),
            t_decided=round(now_s, 6),
            action=Finished().as_json(),
            latency_s=round(asking.latency_s(now_s), 6),
            thinking=False,
            confirmed_by=shown.number,
        )
        self._cockpit.log.write(decision)
        self._cockpit.on_step(decision)
        return decision

    def _row(self, shown: _Shown, asking: Asking | None, orders: FleetOrders, error: str | None) -> Exchange:
        """Return what is logged of an exchange; no `asking` where the reply came too late."""
        reply, now_s = asking.reply() if asking else None, self._now_s()
        served: str | UnsetType = UNSET
        if reply and reply.served != self._served:
            served, self._served = reply.served or self._command.model.name, reply.served
        return Exchange(
            number=shown.number,
            t_asked=round(shown.asked_s, 6),
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
            model=self._command.model.name,
            served=served,
        )
