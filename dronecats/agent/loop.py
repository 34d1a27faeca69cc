"""The loop of the paper's agent: see, decide, act, log. A step gets a frame, the instruction and the past actions.

A `Decider` decides for a group of drones. It sends their pictures in one question, and one reply has an action for each
drone. Its `fly`, inherited from `Asker`, yields while vehicle time passes, so several deciders run side by side.
"""

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor, Future, wait
from dataclasses import dataclass
from typing import Literal, TypeVar

from msgspec import UNSET, UnsetType

from dronecats.agent import action as actions
from dronecats.agent.cockpit import Cockpit
from dronecats.agent.controller import Drone
from dronecats.agent.latency import COMMANDER, Circumstance, LatencyPolicy, Question
from dronecats.agent.models.model import Model, Reply, Request
from dronecats.agent.prompt import Prompt, labels
from dronecats.agent.reply.reading import ReplyParser, reading
from foundation.camera import Frame
from foundation.errors import CameraError, ModelError
from foundation.protocol import CAP_S, HISTORY_LENGTH
from foundation.run_folder.rows import Decision
from foundation.threads import COMPUTING, DaemonExecutor

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Questions:
    """The model of a decider, and the settings of its questions."""

    model: Model
    prompt: Prompt
    instruction: str
    latency: LatencyPolicy
    axis_order: actions.AxisOrder = "xy"
    parser: ReplyParser = "strict"
    patience_s: float | None = None  # vehicle s, longest wait for a frame or a reply before an error; None: no limit
    beside: bool = False  # the lockstep clock may run during the call, as the reply depends only on the question
    last_reply: bool = True  # after the episode's end, await a pending reply, to tell a slow model from a dead endpoint


SLACK_S = 0.15  # tolerance of `latency_s`: three ticks of the 20 Hz clock at which the agent checks for a reply


class PendingQuestion:
    """One question under way. The latency policy sets its latency (the charge) once, before or after the reply."""

    def __init__(
        self,
        model: Model,
        request: Request,
        executor: Executor,
        policy: LatencyPolicy,
        question: Question,
        now_s: float,
        beside: bool = False,
        last_s: float | None = None,
    ) -> None:
        """Send the question at `now_s`; `last_s` is the time of the last reply for these drones (vehicle seconds).

        `beside`: the lockstep clock runs during the call, up to the due time, if the policy foresees the latency.
        """
        self._beside = beside and policy.foreseen
        self._future: Future[Reply] = (DaemonExecutor() if self._beside else executor).submit(model.ask, request)
        self._policy, self._question = policy, question
        self.start_s, self._last_s = now_s, last_s
        self._charged_s: float | None = None

    def due(self, now_s: float) -> bool:
        """Return whether the reply has arrived and its latency has passed on the vehicle's clock."""
        if self._beside:  # only the due time counts: with the real arrival, flights would not be reproducible
            foreseen_s = self._charge() or 0.0
            if now_s < self.start_s + foreseen_s - 1e-9:
                return False
            self._wait()
        if not self._future.done():
            return False
        if self._future.exception() is not None:
            return True
        charged_s = self._charge()
        if charged_s is None:
            return now_s >= self.start_s - 1e-9  # `start_s` is later if a picture is newer than the telemetry
        return now_s >= self.start_s + charged_s - 1e-9

    @property
    def answered(self) -> bool:
        """Return whether the call has come back, with a reply or with an error. With `beside`, wait until it has."""
        if self._beside:
            self._wait()
        return self._future.done()

    def _wait(self) -> None:
        with COMPUTING.lent():
            wait([self._future])

    def reply(self) -> Reply:
        """Return the reply. Raises what the model raised."""
        return self._future.result()

    def latency_s(self, now_s: float) -> float:
        """Return the vehicle seconds that the reply took; `now_s` is the time of the decision.

        Normally this is the charge. Without a charge, or if the elapsed time exceeds the charge by more than SLACK_S,
        it is the elapsed time.
        """
        elapsed_s = (now_s - self.start_s) * self.reply().share  # without failed attempts
        charged_s = self._charge()
        if charged_s is None:
            return elapsed_s
        return charged_s if elapsed_s <= charged_s + SLACK_S else elapsed_s

    def after_s(self, cap_s: float) -> float:
        """Return the due time (vehicle seconds) of a reply that is too late; it is always later than `cap_s`."""
        return max(self.start_s + (self._charge() or 0.0), cap_s + 1e-3)

    def _charge(self) -> float | None:
        """Return the charge in vehicle seconds; None: real latency, nothing is charged."""
        if not self._policy.real and self._charged_s is None:
            reply = None if self._policy.foreseen else self.reply()
            since_s = None if self._last_s is None else self.start_s - self._last_s
            self._charged_s = self._policy.charge_s(self._question, Circumstance(reply, since_s))
        return self._charged_s


class Tally:
    """Numbers the steps of all deciders of an episode together, in the order of the decisions."""

    def __init__(self) -> None:
        self.taken = 0

    def take(self) -> int:
        """Return the next number, from 0."""
        self.taken += 1
        return self.taken - 1


class Asker:
    """Asks one model about drones, one question at a time. Subclasses decide when to ask, and act on the reply."""

    def __init__(self, questions: Questions, cockpit: Cockpit, now_s: Callable[[], float], tally: Tally) -> None:
        """`now_s` reads the episode's clock; all askers of an episode share `tally`."""
        self._questions, self._cockpit, self._now_s, self._tally = questions, cockpit, now_s, tally
        self._questions_sent = 0
        self._answered_s: float | None = None  # time of the last reply
        self._served: str | None = None  # the model of the last reply, as the vendor names it

    def fly(self, cap_s: float, stop: Callable[[Decision], bool]) -> Generator[None, None, bool]:
        """Ask and act until `cap_s`, or until `stop` returns True for a decision; yield once per tick.

        Returns whether `stop` ended the flight. Raises ModelError, CameraError, LinkError.
        """
        while self._now_s() < cap_s:
            decisions = yield from self._turn(cap_s)
            if any(stop(decision) for decision in decisions):
                return True
        return False

    def _turn(self, cap_s: float) -> Generator[None, None, Sequence[Decision]]:
        """Ask, and yield until the reply is acted on; yield once without a question. Return the decisions."""
        raise NotImplementedError

    def _newest_frames(
        self, first: int, drones: Sequence[int], cap_s: float
    ) -> Generator[None, None, list[Frame] | None]:
        """Return the newest frame of each drone for the next question; yield until they arrive.

        `first`: the `drone` of the `latency.Question`. Returns None if a declared disturbance holds the pictures back
        until the episode ends at `cap_s`. Raises CameraError if a picture takes longer than `patience_s`.
        """
        cockpit, now_s, patience_s = self._cockpit, self._now_s, self._questions.patience_s

        def fetched(call: Callable[[], T]) -> Generator[None, None, T]:
            coming = cockpit.executor.submit(call)
            start_s = now_s()
            while not coming.done():
                yield
                if patience_s is not None and now_s() > start_s + patience_s:
                    raise CameraError(
                        f"the camera has sent no image for {patience_s:g} s. Check it with: dronecats camera check URL"
                    )
            return coming.result()

        if cockpit.pictures is None:
            return (yield from fetched(lambda: [cockpit.camera.newest(drone) for drone in drones]))
        question = Question(cockpit.seed, self._questions_sent, first)
        return (
            yield from cockpit.pictures.frames(cockpit.camera, question, drones, now_s, cap_s, cockpit.t0_us, fetched)
        )

    def _ask(
        self,
        text: str,
        frames: Sequence[Frame],
        now_s: float,
        *,
        thinking: bool = False,
        drone: int = 0,
        role: Literal["pilot", "commander"] = "pilot",
    ) -> PendingQuestion:
        """Log and send the question `text` about `frames` at `now_s`; the other arguments are fields of `Request`."""
        questions, cockpit, step, is_pilot = self._questions, self._cockpit, self._questions_sent, role == "pilot"
        taken_us = tuple(frame.time_us for frame in frames) if cockpit.pictures and is_pilot else ()
        request = Request(
            text, cockpit.keep_pictures(frames), thinking, labels(len(frames)), step, drone, role, taken_us
        )
        if cockpit.prompts:
            ids = [frame.frame_id for frame in frames]
            cockpit.prompts.write(role, drone, step, now_s, ids, request.labels, text)
        self._questions_sent += 1
        question, last_s = Question(cockpit.seed, step, drone if is_pilot else COMMANDER), self._answered_s
        return PendingQuestion(
            questions.model, request, cockpit.executor, questions.latency, question, now_s, questions.beside, last_s
        )

    def _await(self, asking: PendingQuestion, cap_s: float) -> Generator[None, None, bool]:
        """Yield until the reply is due or the episode is over; return whether it is due.

        With `last_reply`, wait for a reply under way at `cap_s`, although it is too late to be an action. So a slow
        model is a failure, and a dead endpoint raises an error. Raises ModelError after `patience_s` (None: no limit
        here), and the errors of the model's client.
        """
        questions = self._questions

        def check_patience(more: str) -> None:
            if questions.patience_s is not None and self._now_s() > asking.start_s + questions.patience_s:
                raise ModelError(f"the model has not answered for {questions.patience_s:g} s{more}")

        while not asking.due(self._now_s()):
            yield
            if self._now_s() >= cap_s:
                break
            check_patience(". Check its server")
        if asking.due(self._now_s()):
            return True
        if questions.last_reply:
            while not asking.answered:
                yield
                check_patience(", nor before the end of the episode")
            asking.reply()
        return False

    def _served_anew(self, reply: Reply) -> str | UnsetType:
        """Return the name of the model that answered; UNSET if it is the same as for the last reply."""
        if reply.served == self._served:
            return UNSET
        self._served = reply.served
        return reply.served or self._questions.model.name

    def _since_begin_s(self, frame: Frame) -> float:
        return (frame.time_us - self._cockpit.t0_us) / 1e6


class Decider(Asker):
    """Decides for its drones, step by step. One drone: the paper's pilot. Four drones: the paper's joint command."""

    def __init__(
        self, questions: Questions, drones: Sequence[Drone], cockpit: Cockpit, now_s: Callable[[], float], tally: Tally
    ) -> None:
        super().__init__(questions, cockpit, now_s, tally)
        self._drones = drones
        self._host = cockpit.host.watch() if cockpit.host else None

    def _turn(self, cap_s: float) -> Generator[None, None, Sequence[Decision]]:
        frames = yield from self._see(cap_s)
        return [] if frames is None else (yield from self._step(frames, cap_s))

    def _see(self, cap_s: float) -> Generator[None, None, list[Frame] | None]:
        """Return each drone's newest frame; None if the episode ended first. Drones store the pose of their frame."""
        indices = [drone.index for drone in self._drones]
        start_s = self._host.pace.now_s if self._host else 0.0
        frames = yield from self._newest_frames(indices[0], indices, cap_s)
        if frames is None:
            if not self._tally.taken:
                raise CameraError("no image arrived before the end of the episode")
            return None
        if self._host:
            on_purpose_s = self._cockpit.pictures.held_s[indices[0]] if self._cockpit.pictures else 0.0
            self._host.waited(max(0.0, self._host.pace.now_s - start_s - on_purpose_s) / len(indices))
        for drone, frame in zip(self._drones, frames, strict=True):
            drone.see(frame.time_us)
        return frames

    def _step(self, frames: Sequence[Frame], cap_s: float) -> Generator[None, None, list[Decision]]:
        """Ask, await the reply, and fly its actions; return the decisions when all drones have flown them."""
        COMPUTING.step()
        # a frame may be newer than the newest telemetry, but the time of a question is never before its frames
        start_s = max(self._now_s(), *(self._since_begin_s(frame) for frame in frames))
        thinking = any(drone.thinks_next for drone in self._drones)  # one call decides for all drones
        asking = self._send(frames, thinking, start_s)
        if not (yield from self._await(asking, cap_s)):
            if not self._tally.taken:
                if not asking.answered:
                    raise ModelError("the model sent no reply before the end of the episode")
                # the late reply is logged, to show that the model was slow and not broken
                self._decide(frames, asking, thinking, asking.after_s(cap_s))
            return []  # the episode was over before the reply: too late to be an action
        decisions = self._decide(frames, asking, thinking, self._now_s())
        for drone in self._drones:
            drone.begin(self._now_s())
        yield from self._act(cap_s)
        return decisions

    def _act(self, cap_s: float) -> Generator[None, None, None]:
        """Yield until the decided actions have been flown."""
        while any(drone.busy for drone in self._drones) and self._now_s() < cap_s:
            yield
            for drone in self._drones:
                drone.advance(self._now_s())

    def _send(self, frames: Sequence[Frame], thinking: bool, now_s: float) -> PendingQuestion:
        drones, axis_order = len(self._drones), self._questions.axis_order
        text = self._questions.prompt.render(self._instruction(), self._histories(), HISTORY_LENGTH, axis_order, drones)
        return self._ask(text, frames, now_s, thinking=thinking, drone=self._drones[0].index)

    def _instruction(self) -> str:
        return self._questions.instruction

    def _report(self, action: actions.Action | None) -> bool | UnsetType:
        """Return whether an action is a report to a commander; UNSET if there is no commander."""
        return UNSET

    def _histories(self) -> str:
        if len(self._drones) == 1:
            return self._drones[0].history.render()
        named = zip(labels(len(self._drones)), self._drones, strict=True)
        return "\n".join(f"{label}\n{drone.history.render()}" for label, drone in named)

    def _decide(self, frames: Sequence[Frame], asking: PendingQuestion, thinking: bool, now_s: float) -> list[Decision]:
        reply, step = asking.reply(), self._tally.take()
        rate_hz = None if self._answered_s is None or now_s <= self._answered_s else 1.0 / (now_s - self._answered_s)
        self._answered_s = now_s
        served = self._served_anew(reply)
        lag_s, waited_s = self._host.take() if self._host else (None, None)
        decisions = []
        readings = reading(reply.text, len(self._drones), self._questions.axis_order, self._questions.parser)
        for drone, frame, parsed in zip(self._drones, frames, readings, strict=True):
            action = parsed.action
            decision = Decision(
                step=step,
                drone=drone.index,
                frame_id=frame.frame_id,
                t_frame=round(self._since_begin_s(frame), 6),
                t_decided=round(now_s, 6),
                reply=reply.text,
                action=action.as_json() if action else None,
                error=parsed.error,
                mended=parsed.mended or UNSET,
                latency_s=round(asking.latency_s(now_s), 6),
                tokens_in=reply.tokens_in,
                tokens_out=reply.tokens_out,
                thinking=thinking,
                rate_hz=None if rate_hz is None else round(rate_hz, 6),
                finish=reply.finish or UNSET,
                report=self._report(action),
                served=served,
                tokens_cached=UNSET if reply.tokens_cached is None else reply.tokens_cached,
                tokens_reasoning=UNSET if reply.tokens_reasoning is None else reply.tokens_reasoning,
                endpoint=reply.endpoint or UNSET,
                host_lag_s=UNSET if lag_s is None else round(lag_s, 3),
                frame_wait_s=UNSET if waited_s is None else round(waited_s, 3),
            )
            self._cockpit.log.write(decision)
            drone.thinks_next = isinstance(action, actions.Think)
            if action is not None:
                drone.history.append(action)
            self._cockpit.on_step(decision)
            decisions.append(decision)
            drone.plan(action)
        return decisions


class SideBySideAgent:
    """Flies the drones of one episode with several deciders side by side. Subclasses make the deciders."""

    drone_type: type[Drone] = Drone

    def __init__(self, cockpit: Cockpit) -> None:
        self._cockpit, self._tally = cockpit, Tally()
        self._drones = [
            self.drone_type(i, aircraft, cockpit.camera_model) for i, aircraft in enumerate(cockpit.aircraft)
        ]
        self._deciders: list[Decider] = []
        self._newest_us = cockpit.t0_us

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began, by the newest telemetry of any drone; all clocks start together.

        If a vehicle reboots and restarts its clock, this time does not go back.
        """
        self._newest_us = max(self._newest_us, *(drone.aircraft.time_us for drone in self._drones))
        return (self._newest_us - self._cockpit.t0_us) / 1e6

    @property
    def steps(self) -> int:
        """Number of steps that all deciders have decided."""
        return self._tally.taken

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until the episode's time is over, or until `stop` returns True for a new decision."""
        self._run([decider.fly(cap_s, stop) for decider in self._deciders])

    def _run(self, flights: list[Generator[None, None, bool]]) -> None:
        """Advance `flights` from tick to tick, in their order, until one returns True or all are over."""
        while True:
            for flight in list(flights):
                try:
                    next(flight)
                except StopIteration as over:
                    if over.value:
                        return
                    flights.remove(flight)
            if not flights:
                return
            self._tick()

    def _tick(self) -> None:
        for drone in self._drones:
            drone.aircraft.tick()
        self._cockpit.on_tick()


class PaperAgent(SideBySideAgent):
    """The paper's agent: each drone completes one action before the next picture. Drones of a group share a decider."""

    decider_type: type[Decider] = Decider

    def __init__(self, questions: Questions, cockpit: Cockpit, groups: Sequence[Sequence[int]] | None = None) -> None:
        """`groups`: drones that share a decider. Each group has its own pace. None: one group."""
        super().__init__(cockpit)
        self._deciders = [
            self.decider_type(questions, [self._drones[i] for i in group], cockpit, lambda: self.now_s, self._tally)
            for group in groups or [range(len(self._drones))]
        ]
