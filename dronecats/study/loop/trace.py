"""Flies a sequence of velocity setpoints in lockstep, with this project's autopilot or PX4 in the same vehicle."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.sitl.episode_world import world_of
from dronecats.flight.stages.lockstep import one_vehicle
from dronecats.study.loop.hover import StepResponse
from dronecats.study.loop.margins import StepFigures, step_figures
from episodes.records import catalogue
from foundation.frames import quat_yaw
from hil.link.autopilots import setpoint_message
from hil.link.link import Link
from hil.link.offboard import VelocitySetpoint

Array = NDArray[np.float64]

EPISODE = "v1-residential-searching-01"  # the drone starts with no obstacle within a few metres
HEIGHT_M = 10.0  # height above the ground at which the trace begins
AIRFRAME = "x500"  # default; a quadrotor, because PX4 is supported only for quadrotors
AXES = ("forward", "up", "yaw rate")  # m/s, m/s, rad/s: the columns of a trace response


@dataclass(frozen=True, slots=True)
class TraceStep:
    """A setpoint (forward, up, yaw rate, in the body frame) that is streamed for `seconds`."""

    seconds: float
    forward: float = 0.0  # m/s
    up: float = 0.0  # m/s
    yaw_rate: float = 0.0  # rad/s, + right

    @property
    def setpoint(self) -> tuple[float, float, float]:
        """The setpoint, in the order of AXES."""
        return self.forward, self.up, self.yaw_rate


TRACE = (
    TraceStep(2.0),
    TraceStep(5.0, forward=1.2),  # the paper's fastest command
    TraceStep(4.0),
    TraceStep(5.0, forward=0.5),
    TraceStep(4.0),
    TraceStep(5.0, up=0.5),
    TraceStep(4.0),
    TraceStep(2.0, yaw_rate=float(np.radians(60.0))),  # the paper's turn rate
    TraceStep(3.0),
)


@dataclass(frozen=True, slots=True)
class TraceResponse:
    """The response of a vehicle to TRACE."""

    autopilot: str  # "ours" (this project's) or "px4"
    time: Array  # (n,) s since the trace began, every 10 ms
    setpoints: Array  # (n, 3), columns as in AXES
    measured: Array  # (n, 3), true values, columns as in AXES

    def steps(self) -> list[tuple[str, StepFigures]]:
        """Return (name, figures) of each step that starts from a standstill. Example of a name: `forward 1.2 m/s`."""
        responses, begins = [], 0.0
        for step in TRACE:
            for axis, size in enumerate(step.setpoint):
                if size:
                    during = (self.time >= begins) & (self.time < begins + step.seconds)
                    value = self.measured[during, axis] - self.measured[np.argmax(during), axis]
                    unit = "rad/s" if AXES[axis] == "yaw rate" else "m/s"
                    figures = step_figures(StepResponse(self.time[during] - begins, value, size))
                    responses.append((f"{AXES[axis]} {size:.3g} {unit}", figures))
            begins += step.seconds
        return responses


def step_at(t_s: float) -> TraceStep | None:
    """Return the step at a time of the trace; None after its end."""
    for step in TRACE:
        if t_s < step.seconds:
            return step
        t_s -= step.seconds
    return None


def fly(airframe: str, *, px4: str | None = None, log_dir: Path | None = None, seed: int = 0) -> TraceResponse:
    """Return the response to TRACE of this project's autopilot, or of the PX4 that the command `px4` starts.

    log_dir: existing folder for the output of PX4; None: the output is discarded.
    Raises UsageError; LinkError if the vehicle does not fly; InfrastructureError if PX4 ends.
    """
    world = world_of(catalogue.load(EPISODE), airframe, 1)
    with ExitStack() as ends:
        clock = ends.enter_context(one_vehicle(world, airframe=airframe, seed=seed, px4=px4, log_dir=log_dir))
        link = Link(clock.transport(0), simulated=True)
        ends.callback(link.close)
        ascend([link], [StartOffset((0.0, 0.0, -HEIGHT_M), None)], lambda line: None)
        rows: list[tuple[float, ...]] = []
        truth = clock.simulation.vehicles[0].plant.truth

        def record() -> None:
            yaw = quat_yaw(tuple(truth["attitude"].tolist()))
            north, east, down = truth["velocity_ned"].tolist()
            ahead = north * np.cos(yaw) + east * np.sin(yaw)
            rows.append((float(truth["time_us"]) / 1e6, ahead, -down, float(truth["rates_frd"][2])))

        link.stop_stream()  # the link's own stream would correct height and heading
        clock.followers.append(record)
        begun_us = link.time_us
        while (step := step_at((link.time_us - begun_us) / 1e6)) is not None:
            setpoint = VelocitySetpoint((step.forward, 0.0, -step.up), step.yaw_rate)
            link.send(setpoint_message(setpoint, link.time_us // 1000, link.system, link.component))
            link.tick()
        table = np.array(rows)
    time = table[:, 0] - begun_us / 1e6
    steps = {k: step for k, t in enumerate(time) if (step := step_at(max(t, 0.0))) is not None}
    kept, setpoints = list(steps), np.array([step.setpoint for step in steps.values()])
    return TraceResponse("px4" if px4 else "ours", time[kept], setpoints, table[kept, 1:])
