"""The instruments of a rehearsal: camera, model, vehicle and agent as they are, each with an ear at its door."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from dronecats.agent.cockpit import Agent, AgentFactory, Cockpit
from dronecats.agent.controller import Aircraft
from dronecats.agent.models.model import Model, Reply, Request
from dronecats.flight.run.setup import Instruments
from dronecats.study.rate.chain import ChainClock, QuestionTimes
from dronecats.study.rate.files import ChainLog
from foundation.camera import Camera, Frame
from foundation.protocol import CAP_S
from foundation.run_folder.rows import Decision
from foundation.setpoints import Setpoint, Sight
from hil.cameras.open import PatientCamera
from hil.link.link import Link
from hil.link.offboard import OffboardSetpoint


class RateInstruments(Instruments):
    """Times every question of one flight, keeps each as it is through, and ends the flight after so many."""

    def __init__(self, questions: int | None) -> None:
        """`questions`: how many; None: until the flight is over."""
        self.times: list[QuestionTimes] = []
        self.camera_stamps = (
            False  # whether the camera says when a picture was taken, or nobody knows but of its arrival
        )
        self.run: Path | None = None  # the run folder, once there is one
        self._wanted = questions
        self._log: ChainLog | None = None
        # wall time is the subject here
        self._clock = ChainClock(time.monotonic, self._through)

    def watch(self, link: Link, camera: PatientCamera, run: Path) -> None:
        """Hear every setpoint, and begin the file in the run folder. Raises InfrastructureError."""
        self.run, self.camera_stamps = run, camera.stamps
        self._log = ChainLog(run)
        before = link.on_setpoint

        def hear(setpoint: OffboardSetpoint) -> None:
            before(setpoint)
            self._clock.setpoint_made()

        link.on_setpoint = hear

    def model(self, model: Model) -> Model:
        """Return the model, timed."""
        return TimedModel(model, self._clock)

    def agent(self, make: AgentFactory) -> AgentFactory:
        """Return what makes the same agent in a timed cockpit."""

        def made(cockpit: Cockpit) -> Agent:
            def on_step(decision: Decision) -> None:
                self._clock.decided(decision)
                cockpit.on_step(decision)

            (aircraft,) = cockpit.aircraft
            camera = TimedCamera(cockpit.camera, lambda: aircraft.time_us, self._clock)
            timed = replace(cockpit, camera=camera, aircraft=[TimedAircraft(aircraft, self._clock)], on_step=on_step)
            return CountedAgent(make(timed), self._enough)

        return made

    def close(self) -> None:
        """Close the file."""
        if self._log is not None:
            self._log.close()

    def _through(self, times: QuestionTimes) -> None:
        self.times.append(times)
        if self._log is not None:
            self._log.write(times)

    def _enough(self) -> bool:
        return self._wanted is not None and len(self.times) >= self._wanted


class TimedCamera:
    """A camera whose pictures are timed."""

    def __init__(self, camera: Camera, now_us: Callable[[], int], clock: ChainClock) -> None:
        """`now_us` reads the clock by which frames are stamped."""
        self._camera, self._now_us, self._clock = camera, now_us, clock

    def newest(self, drone: int = 0) -> Frame:
        """Return the camera's newest frame. Raises CameraError."""
        self._clock.picture_asked()
        frame = self._camera.newest(drone)
        # a picture may be newer than what the vehicle has told since
        self._clock.picture_came(max(0.0, (self._now_us() - frame.time_us) / 1e6))
        return frame

    def close(self) -> None:
        self._camera.close()


class TimedModel:
    """A model whose replies are timed."""

    def __init__(self, model: Model, clock: ChainClock) -> None:
        self.name = model.name
        self._model, self._clock = model, clock

    def ask(self, request: Request) -> Reply:
        """Return the model's reply. Raises ModelError."""
        reply = self._model.ask(request)
        self._clock.answered(reply)
        return reply

    def check(self) -> None:
        """Raise UsageError when nothing answers where the model should be."""
        self._model.check()

    def close(self) -> None:
        self._model.close()


class TimedAircraft:
    """A vehicle that tells when the agent looks at it, flies it, and has waited for its tick."""

    def __init__(self, aircraft: Aircraft, clock: ChainClock) -> None:
        self._aircraft, self._clock = aircraft, clock

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        return self._aircraft.time_us

    @property
    def steady(self) -> bool:
        """Whether a turn under way has been made."""
        return self._aircraft.steady

    def sight(self, time_us: int) -> Sight:
        """Return where the vehicle was at a time of its clock (µs). Raises LinkError."""
        return self._aircraft.sight(time_us)

    def fly(self, setpoint: Setpoint, seconds: float | None = None, seen: Sight | None = None) -> None:
        """Take the controller's setpoint for the stream."""
        self._aircraft.fly(setpoint, seconds, seen)
        self._clock.flown()

    def listen(self) -> None:
        """Take in what has already arrived: what an agent does first when it takes up a picture."""
        self._clock.picture_seen()
        self._aircraft.listen()

    def tick(self) -> None:
        """Wait for the next tick of vehicle time. Raises LinkError."""
        self._aircraft.tick()
        self._clock.ticked()


class CountedAgent:
    """An agent that ends its flight when enough has been asked."""

    def __init__(self, agent: Agent, enough: Callable[[], bool]) -> None:
        self._agent, self._enough = agent, enough

    @property
    def now_s(self) -> float:
        """Vehicle seconds since the episode began."""
        return self._agent.now_s

    @property
    def steps(self) -> int:
        """How many steps were decided."""
        return self._agent.steps

    def fly(self, cap_s: float = CAP_S, stop: Callable[[Decision], bool] = lambda decision: False) -> None:
        """Fly until `cap_s`, or until `stop` says so. Raises DronecatsError, and KeyboardInterrupt when it is enough.

        The flight has not come to its end then, and must not say so: it is broken off as by whoever looks on.
        """
        self._agent.fly(cap_s, lambda decision: stop(decision) or self._enough())
        if self._enough():
            raise KeyboardInterrupt
