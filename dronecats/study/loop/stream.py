"""How much jitter and loss of its setpoint stream a vehicle bears: until it tracks half as well, or leaves offboard.

The stream is the agent's: SET_POSITION_TARGET_LOCAL_NED at 20 Hz, bytes of MAVLink through the wire of
`hil/impairment`, on the vehicle's clock.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dronecats.flight.sitl.simulation import TICK_US, BootPose, SimulatedVehicle
from foundation.airframe import Airframe
from foundation.errors import InfrastructureError
from foundation.frames import Vec3
from foundation.mavlink import Packer, dialect
from hil.impairment import Channel, Impairment

ORIGIN = (47.397742, 8.545594, 488.0)
HEIGHT_M = 10.0
LEVEL_MASK = 0b0000_0101_1110_0011  # what is not controlled: x, y, vz, all accelerations, yaw
STREAM_TICKS = 5  # 20 Hz, as the agent sends them
SPEED, ROUND_S = 1.2, 10.0  # m/s, the paper's; s for a circle, so that what comes late was asked for elsewhere
TRIAL_S, CATCH_UP_S, REST_S = 30.0, 5.0, 5.0
SEEDS = (1, 2, 3)
JITTERS_S = (0.0, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1, 1.25, 1.5)
LOSSES = (0.0, 0.3, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)
WORSE = 2.0  # × the tracking error on a perfect wire: what counts as not borne any more


@dataclass(frozen=True, slots=True)
class StreamTrial:
    """What became of a circle flown with one wire."""

    level: float  # s of jitter, or share lost
    error: float  # m/s, rms of the velocity less what was asked for at that moment; of the time in offboard
    left_s: float | None  # s until offboard was left, None when it was not


@dataclass(frozen=True, slots=True)
class Tolerance:
    """What an airframe bears of one impairment."""

    airframe: str
    impairment: str  # jitter or loss
    trials: tuple[tuple[StreamTrial, ...], ...]  # by level, each its seeds

    @property
    def perfect(self) -> float:
        """The tracking error (m/s) on a perfect wire."""
        return self.errors[0]

    @property
    def levels(self) -> tuple[float, ...]:
        return tuple(each[0].level for each in self.trials)

    @property
    def errors(self) -> tuple[float, ...]:
        """The mean tracking error (m/s) of each level."""
        return tuple(float(np.mean([trial.error for trial in each])) for each in self.trials)

    @property
    def doubled(self) -> float | None:
        """The level at which the error is WORSE times that of a perfect wire, straight between levels; None: none."""
        bound, levels, errors = WORSE * self.perfect, self.levels, self.errors
        for k in range(1, len(levels)):
            if errors[k] >= bound:
                share = (bound - errors[k - 1]) / (errors[k] - errors[k - 1])
                return levels[k - 1] + share * (levels[k] - levels[k - 1])
        return None

    @property
    def left(self) -> float | None:
        """The first level at which any flight left offboard, None where none did."""
        return next((each[0].level for each in self.trials if any(t.left_s is not None for t in each)), None)


def asked(t_s: float) -> Vec3:
    """Return the velocity (m/s, NED) that the circle asks for at a time."""
    turned = 2.0 * math.pi * t_s / ROUND_S
    return SPEED * math.cos(turned), SPEED * math.sin(turned), 0.0


class StreamedVehicle:
    """One vehicle of ours in the air, in offboard, and the wire on which its setpoints come."""

    def __init__(self, airframe: Airframe, seed: int = 1) -> None:
        """Boot, take off and settle. Raises InfrastructureError when it does not fly."""
        self.vehicle = SimulatedVehicle(0, airframe, BootPose((0.0, 0.0, 0.0), 0.0), seed=seed, origin=ORIGIN)
        self._port = self.vehicle.open_port("minimal")
        self._agent = Packer(255, dialect.MAV_COMP_ID_MISSIONPLANNER)
        commander = self.vehicle.autopilot.commander
        while commander.arming_failures() and self.vehicle.time_us < 60_000_000:
            self.vehicle.advance()
        commander.take_off(HEIGHT_M)
        commander.arm()
        for _ in range(1500):
            self.vehicle.advance()
        self._down = float(self.vehicle.core.estimate["position_ned"][2])
        self._rest()
        if commander.mode != "OFFBOARD":
            raise InfrastructureError(f"{airframe.name} does not fly: its mode is {commander.mode}")

    def trial(self, level: float, wire: Impairment, seed: int) -> StreamTrial:
        """Fly the circle with its setpoints over a wire, on a full battery, and stand still on a perfect one."""
        self.vehicle.plant.state["charge_ah"] = self.vehicle.plant.params["capacity_ah"]
        channel, truth = Channel(wire, seed), self.vehicle.plant.truth
        errors, left_s = [], None
        for tick in range(round(TRIAL_S * 1e6) // TICK_US):
            t_s = tick * TICK_US / 1e6
            if tick % STREAM_TICKS == 0:
                channel.put(t_s, self._setpoint(asked(t_s)))
            for unit in channel.arrived(t_s):
                self._port.receive(unit)
            self.vehicle.advance()
            self._port.take()
            if self.vehicle.autopilot.commander.mode != "OFFBOARD":
                left_s = t_s
                break
            if t_s >= CATCH_UP_S:
                north, east, _ = asked(t_s)
                errors.append((truth["velocity_ned"][0] - north) ** 2 + (truth["velocity_ned"][1] - east) ** 2)
        self._rest()
        return StreamTrial(level, math.sqrt(float(np.mean(errors))) if errors else math.nan, left_s)

    def _rest(self) -> None:
        """Stand still in offboard."""
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


def tolerances(
    airframe: Airframe,
    jitters_s: Sequence[float] = JITTERS_S,
    losses: Sequence[float] = LOSSES,
    seeds: Sequence[int] = SEEDS,
) -> tuple[Tolerance, Tolerance]:
    """Return what an airframe bears of jitter and of loss.

    The levels rise from 0, a perfect wire, and end with the first at which offboard is left. Raises InfrastructureError
    when it does not fly.
    """
    flown = StreamedVehicle(airframe)
    found = []
    wires: tuple[tuple[str, Callable[[float], Impairment], Sequence[float]], ...] = (
        ("jitter", lambda level: Impairment(jitter_s=level), jitters_s),
        ("loss", lambda level: Impairment(loss=level), losses),
    )
    for kind, wire, levels in wires:
        trials: list[tuple[StreamTrial, ...]] = []
        for level in levels:
            trials.append(tuple(flown.trial(level, wire(level), seed) for seed in seeds))
            if any(trial.left_s is not None for trial in trials[-1]):
                break
        found.append(Tolerance(airframe.name, kind, tuple(trials)))
    return found[0], found[1]
