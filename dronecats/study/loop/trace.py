"""One trace of velocity setpoints, flown by our autopilot or by a real PX4 in the same vehicle, in lockstep."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dronecats.flight.run.ascent import StartOffset, ascend
from dronecats.flight.sitl.lockstep import one_vehicle
from dronecats.flight.sitl.simulation import world_of
from dronecats.study.loop.hover import StepAnswer
from dronecats.study.loop.margins import StepFigures, step_figures
from episodes.records import catalogue
from foundation.frames import quat_yaw
from hil.link.autopilots import PX4
from hil.link.link import Link
from hil.link.offboard import VelocitySetpoint

Array = NDArray[np.float64]

EPISODE = "v1-residential-searching-01"  # where nothing stands in the way of a few metres
HEIGHT_M = 10.0
AIRFRAME = "x500"  # if none is named; PX4 flies quadrotors here
AXES = ("forward", "up", "yaw rate")  # m/s, m/s, rad/s: the columns of a flown trace


@dataclass(frozen=True, slots=True)
class TraceStep:
    """A setpoint that is streamed for a while, in a body frame: forward, up and a yaw rate."""

    seconds: float
    forward: float = 0.0  # m/s
    up: float = 0.0  # m/s
    yaw_rate: float = 0.0  # rad/s, + right

    @property
    def asked(self) -> tuple[float, float, float]:
        """What is asked for, by AXES."""
        return self.forward, self.up, self.yaw_rate


TRACE = (
    TraceStep(2.0),
    TraceStep(5.0, forward=1.2),  # the paper's fastest
    TraceStep(4.0),
    TraceStep(5.0, forward=0.5),
    TraceStep(4.0),
    TraceStep(5.0, up=0.5),
    TraceStep(4.0),
    TraceStep(2.0, yaw_rate=float(np.radians(60.0))),  # the paper's turn
    TraceStep(3.0),
)


@dataclass(frozen=True, slots=True)
class FlownTrace:
    """What a vehicle made of TRACE."""

    autopilot: str  # ours or px4
    time: Array  # (n,) s since the trace began, every 10 ms
    asked: Array  # (n, 3), by AXES
    flown: Array  # (n, 3), by AXES: the truth

    def steps(self) -> list[tuple[str, StepFigures]]:
        """Return what became of each step from a stand, by a name such as `forward 1.2 m/s`."""
        found, begins = [], 0.0
        for step in TRACE:
            for axis, size in enumerate(step.asked):
                if size:
                    during = (self.time >= begins) & (self.time < begins + step.seconds)
                    value = self.flown[during, axis] - self.flown[np.argmax(during), axis]
                    unit = "rad/s" if AXES[axis] == "yaw rate" else "m/s"
                    figures = step_figures(StepAnswer(self.time[during] - begins, value, size))
                    found.append((f"{AXES[axis]} {size:.3g} {unit}", figures))
            begins += step.seconds
        return found


def asked_at(t_s: float) -> TraceStep | None:
    """Return the step that is streamed at a time of the trace, None when it is over."""
    for step in TRACE:
        if t_s < step.seconds:
            return step
        t_s -= step.seconds
    return None


def fly(
    airframe: str,
    *,
    px4: str | None = None,
    log_dir: Path | None = None,
    seed: int = 0,
    say: Callable[[str], None] = lambda line: None,
) -> FlownTrace:
    """Return what our autopilot, or the PX4 that the command `px4` starts, makes of the trace.

    log_dir: a folder that stands, in which what PX4 prints stays; None: it does not.
    Raises UsageError, LinkError where it does not fly, InfrastructureError where PX4 ends.
    """
    world = world_of(catalogue.load(EPISODE), airframe, 1)
    with ExitStack() as ends:
        clock = ends.enter_context(one_vehicle(world, airframe=airframe, seed=seed, px4=px4, log_dir=log_dir))
        link = Link(clock.transport(0), simulated=True)
        ends.callback(link.close)
        ascend([link], [StartOffset((0.0, 0.0, -HEIGHT_M), None)], say)
        rows: list[tuple[float, ...]] = []
        truth = clock.simulation.vehicles[0].plant.truth

        def look() -> None:
            yaw = quat_yaw(tuple(truth["attitude"].tolist()))
            north, east, down = truth["velocity_ned"].tolist()
            ahead = north * np.cos(yaw) + east * np.sin(yaw)
            rows.append((float(truth["time_us"]) / 1e6, ahead, -down, float(truth["rates_frd"][2])))

        link.stop_stream()  # its own loops for height and heading are not what is looked at
        clock.followers.append(look)
        begun_us = link.time_us
        while (step := asked_at((link.time_us - begun_us) / 1e6)) is not None:
            setpoint = VelocitySetpoint((step.forward, 0.0, -step.up), step.yaw_rate)
            link.send(PX4.setpoint_message(setpoint, link.time_us // 1000, link.system, link.component))
            link.tick()
        table = np.array(rows)
    time = table[:, 0] - begun_us / 1e6
    kept = [k for k, t in enumerate(time) if asked_at(max(t, 0.0)) is not None]
    wanted = np.array([step.asked for t in time[kept] if (step := asked_at(max(t, 0.0))) is not None])
    return FlownTrace("px4" if px4 else "ours", time[kept], wanted, table[kept, 1:])
