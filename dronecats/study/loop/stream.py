"""Measures the jitter and loss of a setpoint stream at which tracking degrades or offboard mode ends.

The stream is the same as the agent's: SET_POSITION_TARGET_LOCAL_NED at 20 Hz, sent as MAVLink bytes through the
simulated wire of `hil/impairment`, on the vehicle's clock.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dronecats.flight.sitl.simulation import TICK_US, BootPose, SimulatedVehicle
from foundation.airframe import Airframe
from foundation.errors import InfrastructureError
from foundation.frames import PX4_HOME, Vec3
from foundation.mavlink import Packer, dialect
from hil.impairment import Channel, Impairment

HEIGHT_M = 10.0
LEVEL_MASK = 0b0000_0101_1110_0011  # type mask: ignore x, y, vz, all accelerations and yaw
STREAM_TICKS = 5  # ticks between two setpoints: 20 Hz, as for the agent
# m/s, the paper's fastest command; s per circle. On a circle, every late setpoint has a wrong direction
SPEED, ROUND_S = 1.2, 10.0
TRIAL_S, CATCH_UP_S, REST_S = 30.0, 5.0, 5.0  # s: flight on the circle, its unscored beginning, hover after it
SEEDS = (1, 2, 3)
JITTERS_S = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1, 1.25, 1.5)
LOSSES = (0.0, 0.3, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)
ERROR_RATIO_LIMIT = 2.0  # × the tracking error on a perfect link: a larger error is not tolerated


@dataclass(frozen=True, slots=True)
class StreamTrial:
    """The result of one flight on the circle, with setpoints over one simulated wire."""

    level: float  # jitter (s), or share of lost setpoints
    error: float  # m/s, rms velocity error in offboard mode after CATCH_UP_S; nan: the mode ended earlier
    left_s: float | None  # s until the vehicle left offboard mode; None: it stayed


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The tolerance of an airframe to one impairment."""

    airframe: str
    impairment: str  # jitter or loss
    trials: tuple[tuple[StreamTrial, ...], ...]  # by level, then by seed

    @property
    def perfect_error(self) -> float:
        """The tracking error (m/s) on a perfect link."""
        return self.errors[0]

    @property
    def levels(self) -> tuple[float, ...]:
        return tuple(trials[0].level for trials in self.trials)

    @property
    def errors(self) -> tuple[float, ...]:
        return tuple(float(np.mean([trial.error for trial in trials])) for trials in self.trials)

    @property
    def doubled_at(self) -> float | None:
        """The interpolated level at which the error is ERROR_RATIO_LIMIT × `perfect_error`; None: no such level."""
        bound, levels, errors = ERROR_RATIO_LIMIT * self.perfect_error, self.levels, self.errors
        for k in range(1, len(levels)):
            if errors[k] >= bound:
                share = (bound - errors[k - 1]) / (errors[k] - errors[k - 1])
                return levels[k - 1] + share * (levels[k] - levels[k - 1])
        return None

    @property
    def left_offboard_at(self) -> float | None:
        """The first level at which a flight left offboard mode; None if no flight did."""
        return next((trials[0].level for trials in self.trials if any(t.left_s is not None for t in trials)), None)


def circle_velocity(t_s: float) -> Vec3:
    """Return the commanded velocity (m/s, NED) at a time on the circle."""
    angle = 2.0 * math.pi * t_s / ROUND_S
    return SPEED * math.cos(angle), SPEED * math.sin(angle), 0.0


class StreamedVehicle:
    """A simulated vehicle that hovers in offboard mode and flies trials over impaired wires."""

    def __init__(self, airframe: Airframe) -> None:
        """Boot, take off and settle. Raises InfrastructureError if the vehicle is then not in offboard mode."""
        self.vehicle = SimulatedVehicle(0, airframe, BootPose((0.0, 0.0, 0.0), 0.0), seed=1, origin=PX4_HOME)
        self._port = self.vehicle.open_port("minimal")
        self._agent = Packer(255, dialect.MAV_COMP_ID_MISSIONPLANNER)
        commander = self.vehicle.autopilot.commander
        while commander.arming_failures() and self.vehicle.time_us < 60_000_000:
            self.vehicle.advance()
        commander.take_off(-HEIGHT_M)
        commander.arm()
        for _ in range(1500):
            self.vehicle.advance()
        self._down = float(self.vehicle.core.estimate["position_ned"][2])
        self._rest()
        if commander.mode != "OFFBOARD":
            raise InfrastructureError(f"{airframe.name} does not fly: its mode is {commander.mode}")

    def trial(self, level: float, wire: Impairment, seed: int) -> StreamTrial:
        """Fly the circle on a full battery with setpoints over `wire`, then hover on a perfect link."""
        self.vehicle.plant.state["charge_ah"] = self.vehicle.plant.params["capacity_ah"]
        channel, truth = Channel(wire, seed), self.vehicle.plant.truth
        errors, left_s = [], None
        for tick in range(round(TRIAL_S * 1e6) // TICK_US):
            t_s = tick * TICK_US / 1e6
            if tick % STREAM_TICKS == 0:
                channel.put(t_s, self._setpoint(circle_velocity(t_s)))
            for unit in channel.arrived(t_s):
                self._port.receive(unit)
            self.vehicle.advance()
            self._port.take()
            if self.vehicle.autopilot.commander.mode != "OFFBOARD":
                left_s = t_s
                break
            if t_s >= CATCH_UP_S:
                north, east, _ = circle_velocity(t_s)
                errors.append((truth["velocity_ned"][0] - north) ** 2 + (truth["velocity_ned"][1] - east) ** 2)
        self._rest()
        return StreamTrial(level, math.sqrt(float(np.mean(errors))) if errors else math.nan, left_s)

    def _rest(self) -> None:
        """Hover in offboard mode for REST_S."""
        for tick in range(round(REST_S * 1e6) // TICK_US):
            if tick % STREAM_TICKS == 0:
                self._port.receive(self._setpoint((0.0, 0.0, 0.0)))
            if tick == 2 * STREAM_TICKS:
                self.vehicle.autopilot.commander.set_mode("OFFBOARD")
            self.vehicle.advance()
            self._port.take()

    def _setpoint(self, velocity_ned: Vec3) -> bytes:
        return self._agent.pack(
            dialect.MAVLink_set_position_target_local_ned_message(
                self.vehicle.time_us // 1000, 1, 1, dialect.MAV_FRAME_LOCAL_NED, LEVEL_MASK,
                0, 0, self._down, *velocity_ned, 0, 0, 0, 0, 0,
            )
        )  # fmt: skip


def tolerances(airframe: Airframe) -> tuple[Tolerance, Tolerance]:
    """Return the tolerance of an airframe to jitter and to loss.

    Levels are flown in rising order, from 0 (a perfect link) to the first at which the vehicle leaves offboard mode.
    Raises InfrastructureError if the vehicle does not fly.
    """
    vehicle = StreamedVehicle(airframe)
    tolerances = []
    wires: tuple[tuple[str, Callable[[float], Impairment], Sequence[float]], ...] = (
        ("jitter", lambda level: Impairment(jitter_s=level), JITTERS_S),
        ("loss", lambda level: Impairment(loss=level), LOSSES),
    )
    for kind, wire, levels in wires:
        trials: list[tuple[StreamTrial, ...]] = []
        for level in levels:
            trials.append(tuple(vehicle.trial(level, wire(level), seed) for seed in SEEDS))
            if any(trial.left_s is not None for trial in trials[-1]):
                break
        tolerances.append(Tolerance(airframe.name, kind, tuple(trials)))
    return tolerances[0], tolerances[1]
