"""Instruments of a rate study: wrappers that time the camera, model, vehicle and agent without changing them.

A question is one request to the model, with its picture.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit
from dronecats.agent.controller import Aircraft
from dronecats.agent.models.model import Model, Reply, Request, WrappedModel
from dronecats.flight.run.setup import Instruments
from dronecats.study.rate.chain import ChainClock, ChainLog, QuestionTimes
from foundation.camera import Camera, Frame
from foundation.protocol import CAP_S
from foundation.run_folder.rows import Decision
from foundation.setpoints import PicturePose, Setpoint
from hil.cameras.open import PatientCamera
from hil.link.link import Link
from hil.link.offboard import OffboardSetpoint


class RateInstruments(Instruments):
    """Times every question of one flight, writes the times to chain.csv, and ends the flight after `questions`."""

    def __init__(self, questions: int | None) -> None:
        """`questions`: number of questions; None: until the flight ends."""
        self.times: list[QuestionTimes] = []
        self.camera_stamps = False  # whether the camera stamps frames at capture; if not, they have the time of arrival
        self.run: Path | None = None  # the run folder; None: not created yet
        self._questions = questions
        self._log: ChainLog | None = None
        # time.monotonic: the study measures wall time
        self._clock = ChainClock(time.monotonic, self._on_times)

    def watch(self, link: Link, camera: PatientCamera, run: Path) -> None:
        """Observe every setpoint, and create chain.csv in the run folder. Raises InfrastructureError."""
        self.run, self.camera_stamps = run, camera.stamps
        self._log = ChainLog(run)
        before = link.on_setpoint

        def on_setpoint(setpoint: OffboardSetpoint) -> None:
            before(setpoint)
            self._clock.setpoint_ready()

        link.on_setpoint = on_setpoint

    def model(self, model: Model) -> Model:
        """Return the model with a wrapper that times its replies."""
        return TimedModel(model, self._clock)

    def agent(self, make: AgentFactory) -> AgentFactory:
        """Return a factory that makes the same agent with a timed camera, vehicle and steps."""

        def make_timed(cockpit: Cockpit) -> Agent:
            def on_step(decision: Decision) -> None:
                self._clock.decided(decision)
                cockpit.on_step(decision)

            (aircraft,) = cockpit.aircraft
            camera = TimedCamera(cockpit.camera, lambda: aircraft.time_us, self._clock)
            timed = replace(cockpit, camera=camera, aircraft=[TimedAircraft(aircraft, self._clock)], on_step=on_step)
            return CountedAgent(make(timed), self._is_done)

        return make_timed

    def close(self) -> None:
        if self._log is not None:
            self._log.close()

    def _on_times(self, times: QuestionTimes) -> None:
        self.times.append(times)
        if self._log is not None:
            self._log.write(times)

    def _is_done(self) -> bool:
        return self._questions is not None and len(self.times) >= self._questions


class TimedCamera:
    """A camera whose pictures are timed."""

    def __init__(self, camera: Camera, now_us: Callable[[], int], clock: ChainClock) -> None:
        """`now_us` reads the clock (µs) of the frames' time stamps."""
        self._camera, self._now_us, self._clock = camera, now_us, clock

    def newest(self, drone: int = 0) -> Frame:
        self._clock.picture_requested()
        frame = self._camera.newest(drone)
        # not negative: a picture may be newer than the newest telemetry, whose time the clock shows
        self._clock.picture_arrived(max(0.0, (self._now_us() - frame.time_us) / 1e6))
        return frame

    def close(self) -> None:
        self._camera.close()


class TimedModel(WrappedModel):
    def __init__(self, model: Model, clock: ChainClock) -> None:
        super().__init__(model)
        self._clock = clock

    def ask(self, request: Request) -> Reply:
        reply = self._model.ask(request)
        self._clock.answered(reply)
        return reply


class TimedAircraft:
    """A vehicle that records when the agent takes a picture, sets a setpoint, and has waited for a tick."""

    def __init__(self, aircraft: Aircraft, clock: ChainClock) -> None:
        self._aircraft, self._clock = aircraft, clock

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        return self._aircraft.time_us

    @property
    def steady(self) -> bool:
        """Whether the vehicle has completed its current turn."""
        return self._aircraft.steady

    def sight(self, time_us: int) -> PicturePose:
        """Return the vehicle's pose at a time of its clock (µs). Raises LinkError."""
        return self._aircraft.sight(time_us)

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: PicturePose | None = None) -> None:
        """Stream the controller's setpoint."""
        self._aircraft.fly(setpoint, seconds, seen)
        self._clock.controller_done()

    def listen(self) -> None:
        """Process received telemetry. An agent calls this first when it takes a picture."""
        self._clock.picture_seen()
        self._aircraft.listen()

    def tick(self) -> None:
        """Wait for the next tick of vehicle time. Raises LinkError."""
        self._aircraft.tick()
        self._clock.ticked()


class CountedAgent:
    """An agent that ends its flight after the requested number of questions."""

    def __init__(self, agent: Agent, is_done: Callable[[], bool]) -> None:
        self._agent, self._is_done = agent, is_done

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began."""
        return self._agent.now_s

    @property
    def steps(self) -> int:
        """The number of steps with a decision."""
        return self._agent.steps

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until `cap_s` or until `stop`. Raises DronecatsError, and KeyboardInterrupt after the last question.

        The KeyboardInterrupt makes the flight count as interrupted, because the study stops the flight early.
        """
        self._agent.fly(cap_s, lambda decision: stop(decision) or self._is_done())
        if self._is_done():
            raise KeyboardInterrupt
