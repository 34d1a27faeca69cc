"""The loop of the paper: see, decide, act, log. It knows a frame, an instruction, its history, and MAVLink."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

from dronecats.agent import action as actions
from dronecats.agent.controller import Segment, plan
from dronecats.agent.decisions import Decision, DecisionLog
from dronecats.agent.history import History
from dronecats.agent.last_reply import outlast
from dronecats.agent.latency import Asking, Latency
from dronecats.agent.models.model import Model, Request
from dronecats.agent.prompt import Prompt
from dronecats.agent.vehicle import Vehicle
from dronecats.rundir.layout import frame_name
from foundation.camera import Camera, CameraModel, Frame
from foundation.errors import CameraError, ModelError
from foundation.picture import encode
from foundation.protocol import CAP_S as CAP_S
from foundation.protocol import HISTORY_LENGTH
from foundation.setpoints import Hold, Sight


@dataclass(frozen=True, slots=True)
class Pilot:
    """The model and everything that is declared about it."""

    model: Model
    prompt: Prompt
    instruction: str
    latency: Latency
    axis_order: actions.AxisOrder = "xy"
    patience_s: float | None = None  # s of vehicle time without a frame or a reply, then the flight ends; None: theirs
    last_reply: bool = True  # one that is under way at the cap is waited for: whether its model is slow, or dead


@dataclass(slots=True)
class Drone:
    """One vehicle under the pilot, with what the agent remembers of it."""

    index: int
    vehicle: Vehicle
    history: History
    thinks_next: bool = False  # its newest reply asked to reason at length in the next call
    segments: list[Segment] = field(default_factory=list)  # what is still to be flown of the current action
    segment_ends_s: float = 0.0
    seen: Sight | None = None  # where it was when the picture was taken on which it acts


class Agent:
    """Flies one episode. Everything it touches comes in through the constructor."""

    def __init__(
        self,
        *,
        pilot: Pilot,
        vehicles: Sequence[Vehicle],
        camera: Camera,
        camera_model: CameraModel,
        log: DecisionLog,
        frames_dir: Path,
        executor: Executor,
        t0_us: int,
        on_step: Callable[[Decision], None] = lambda decision: None,
        on_tick: Callable[[], None] = lambda: None,
    ) -> None:
        self.pilot = pilot
        self.drones = [Drone(i, vehicle, History(camera_model)) for i, vehicle in enumerate(vehicles)]
        self.camera, self.camera_model = camera, camera_model
        self.log, self.frames_dir = log, frames_dir
        self.executor = executor
        self.t0_us = t0_us
        self.on_step, self.on_tick = on_step, on_tick
        self.steps = 0
        self._decided_s: float | None = None

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began, by the drone that has heard of the latest: all boot at once."""
        return (max(drone.vehicle.time_us for drone in self.drones) - self.t0_us) / 1e6

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly steps until the episode's time is over, or until `stop` says so of a decision just made."""
        while self.now_s < cap_s:
            decisions = self._step(cap_s)
            if any(stop(decision) for decision in decisions):
                return

    def _step(self, cap_s: float) -> list[Decision]:
        frames = self._see()
        for drone, frame in zip(self.drones, frames, strict=True):
            drone.vehicle.listen()  # a frame takes its time to come, which is not the model's
            drone.seen = drone.vehicle.sight(frame.time_us)
        # a frame may be newer than what its drone has told since; no reply is older than its picture
        asked_s = max(self.now_s, *((frame.time_us - self.t0_us) / 1e6 for frame in frames))
        asking, thinking = self._ask(frames, asked_s)
        patience_s = self.pilot.patience_s
        while not asking.due(self.now_s):
            self._tick()
            if self.now_s >= cap_s:
                break
            if patience_s is not None and self.now_s > asked_s + patience_s:
                raise ModelError(f"the model has not answered for {patience_s:g} s: no decision, no flight")
        if not asking.due(self.now_s):
            if self.pilot.last_reply:
                outlast(asking, self._tick, lambda: self.now_s - asked_s, patience_s)
            if not self.steps:
                raise ModelError("the model did not answer once before the episode was over")
            return []  # the episode is over before the reply: whatever it says came too late to be an action
        decisions = self._decide(frames, asking, thinking)
        self._act(cap_s)
        return decisions

    def _see(self) -> list[Frame]:
        """Return every drone's newest frame. The vehicles are kept holding meanwhile: a fleet's frames take a while."""
        coming = self.executor.submit(lambda: [self.camera.newest(drone.index) for drone in self.drones])
        asked_s, patience_s = self.now_s, self.pilot.patience_s
        while not coming.done():
            self._tick()
            if patience_s is not None and self.now_s > asked_s + patience_s:
                raise CameraError(f"the camera has not answered for {patience_s:g} s: no picture, no flight")
        return coming.result()

    def _ask(self, frames: Sequence[Frame], now_s: float) -> tuple[Asking, bool]:
        pictures = tuple(encode(frame.image_rgb) for frame in frames)
        for frame, jpeg in zip(frames, pictures, strict=True):
            (self.frames_dir / frame_name(frame.frame_id, frame.drone)).write_bytes(jpeg)
        thinking = any(drone.thinks_next for drone in self.drones)  # one call answers for all of them
        text = self.pilot.prompt.render(
            self.pilot.instruction, self._histories(), HISTORY_LENGTH, self.pilot.axis_order, len(self.drones)
        )
        request = Request(text, pictures, thinking)
        return Asking(self.pilot.model, request, self.executor, self.pilot.latency, now_s), thinking

    def _histories(self) -> str:
        if len(self.drones) == 1:
            return self.drones[0].history.render()
        return "\n".join(f"Drone {drone.index + 1}:\n{drone.history.render()}" for drone in self.drones)

    def _decide(self, frames: Sequence[Frame], asking: Asking, thinking: bool) -> list[Decision]:
        reply, now_s = asking.reply(), self.now_s
        rate_hz = None if self._decided_s is None or now_s <= self._decided_s else 1.0 / (now_s - self._decided_s)
        self._decided_s = now_s
        decisions = []
        parsed = actions.parse_fleet(reply.text, len(self.drones), self.pilot.axis_order)
        for drone, frame, outcome in zip(self.drones, frames, parsed, strict=True):
            action = None if isinstance(outcome, actions.ActionError) else outcome
            decision = Decision(
                step=self.steps,
                drone=drone.index,
                frame_id=frame.frame_id,
                t_frame=round((frame.time_us - self.t0_us) / 1e6, 6),
                t_decided=round(now_s, 6),
                reply=reply.text,
                action=action.as_json() if action else None,
                error=str(outcome) if isinstance(outcome, actions.ActionError) else None,
                latency_s=round(asking.latency_s(now_s), 6),
                tokens_in=reply.tokens_in,
                tokens_out=reply.tokens_out,
                thinking=thinking,
                rate_hz=None if rate_hz is None else round(rate_hz, 6),
            )
            self.log.write(decision)
            drone.thinks_next = isinstance(action, actions.Think)
            if action is not None:
                drone.history.append(action)
            drone.segments = list(plan(action, self.camera_model))
            self.on_step(decision)
            decisions.append(decision)
        self.steps += 1
        return decisions

    def _act(self, cap_s: float) -> None:
        for drone in self.drones:
            self._next_segment(drone, self.now_s)
        while any(drone.segments for drone in self.drones) and self.now_s < cap_s:
            self._tick()
            for drone in self.drones:
                if drone.segments and self._is_over(drone):
                    settled = drone.segments.pop(0).settle_s > 0.0
                    self._next_segment(drone, self.now_s if settled else drone.segment_ends_s)

    def _is_over(self, drone: Drone) -> bool:
        """Return whether the segment has been flown; a turn has been when the vehicle has made it, and stands."""
        late_s = self.now_s - drone.segment_ends_s
        return late_s >= -1e-9 and (drone.vehicle.steady or late_s >= drone.segments[0].settle_s)

    def _next_segment(self, drone: Drone, starts_s: float) -> None:
        if drone.segments:
            segment = drone.segments[0]
            drone.segment_ends_s = starts_s + segment.duration_s
            seconds = drone.segment_ends_s + segment.settle_s - self.now_s
            drone.vehicle.fly(segment.setpoint, seconds, drone.seen)
        else:
            drone.vehicle.fly(Hold())

    def _tick(self) -> None:
        for drone in self.drones:
            drone.vehicle.tick()
        self.on_tick()
