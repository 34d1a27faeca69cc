"""Defines the interface of a stage (the environment of an episode) and the common parts of simulated stages.

Disturbances of links, setpoint rate, air and sensors begin with the episode, so they do not change the take-off. The
disturbances of links end before the landing. A payload is a disturbance too, but it acts from boot.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Protocol

from dronecats.flight.logger.estimate_process import EstimateLoggerConfig
from dronecats.flight.logger.recorder import LoggerConfig
from dronecats.flight.processes.supervisor import ChildKind
from dronecats.flight.sitl.config import CameraConfig, SimulatorConfig, TruthBridgeConfig, noise_seed
from dronecats.flight.spec.disturbances import UNDISTURBED, FrameFaults
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.camera import Camera, CameraModel
from foundation.errors import DronecatsError
from foundation.run_folder import layout
from foundation.truth import KEPT
from hil.impairment import ImpairedWire, Impairment, SteppedWire
from hil.link.conversation import SILENCE_S
from hil.link.link import Link


class TruthTap(Protocol):
    """A subscription to the truth bus. The agent never has one."""

    def drain(self) -> None:
        """Process the samples that have arrived."""
        ...

    def close(self) -> None: ...


class Stage:
    """Vehicles, camera, clock and logger of an episode: in one process for lockstep, over sockets in real time."""

    links: Sequence[Link]
    camera: Camera
    camera_model: CameraModel
    executor: Executor  # runs calls that may take long
    lockstep = False  # whether vehicle time waits for the agent, and all parts are in this process
    speed: float | None = 1.0  # factor on real time at which the vehicle's clock should run; None: lockstep

    def begin(self, t0_us: int, cap_s: float) -> None:
        """Start the episode at vehicle time `t0_us` (µs), which is time zero for camera, logger and targets.

        `cap_s`: the length of the flight in seconds, for the log.
        """
        raise NotImplementedError

    def mend(self) -> None:
        """End the disturbances between agent and vehicles, before the order to land."""

    def end(self, reason: str, error: str | None = None) -> None:
        """Tell the logger that the episode is over."""
        raise NotImplementedError

    def check(self) -> None:
        """Raise InfrastructureError if a process of the stage is gone. In lockstep, parts raise their own errors."""

    def check_vehicles(self) -> None:
        """Raise InfrastructureError if the simulator of the vehicles is gone, so that none of them can land."""

    def cause(self, error: DronecatsError) -> DronecatsError:
        """Return the cause of an error: the error of a process that is gone or hangs, else `error` itself.

        May take some seconds.
        """
        return error

    def close(self) -> None:
        raise NotImplementedError


class TruthfulStage(Stage):
    """A stage with a truth bus, which carries the true poses of the drones."""

    def tap(self, feed: Callable[[bytes], None]) -> TruthTap:
        """Subscribe a function to the truth bus, for example a function of the oracle pilot."""
        raise NotImplementedError


SIMULATOR = ChildKind("simulator", "dronecats.flight.sitl.simulator_process:create", SimulatorConfig)
CAMERA = ChildKind("camera", "dronecats.flight.sitl.camera:CameraPart", CameraConfig)
TRUTH_BRIDGE = ChildKind("truth-bridge", "dronecats.flight.sitl.truth_bridge:TruthBridge", TruthBridgeConfig)
LOGGER = ChildKind("logger", "dronecats.flight.logger.logger_process:Logger", LoggerConfig)
ESTIMATE_LOGGER = ChildKind(
    "estimate-logger", "dronecats.flight.logger.estimate_process:EstimateLogger", EstimateLoggerConfig
)
TRUTH_HZ = 50.0  # samples of each drone on the truth bus per second


def simulator_config(spec: FlightSpec, simulated: Simulated, folder: Path) -> SimulatorConfig:
    """Return the simulator's configuration for a flight whose record is in `folder`."""
    return SimulatorConfig(
        episode=str(folder / layout.EPISODE),
        airframe=simulated.airframe,
        seed=spec.seed,
        speed=simulated.speed,
        autopilot=simulated.autopilot,
        px4=simulated.px4,
        log_dir=str(folder),
        keep_ulogs=str(folder) if spec.keep_ulog else None,
        disturbances=spec.disturbances.vehicle,
    )


def truth_kept(faults: FrameFaults) -> int:
    """Return the number of truth samples that a camera keeps, so that it can draw pictures of earlier times."""
    return KEPT + math.ceil(faults.reach_s * TRUTH_HZ)


class DisturbedLinks:
    """Applies the flight's disturbances of links and setpoint rate."""

    def __init__(self, flight: Flight) -> None:
        self._disturbances, self._seconds = flight.spec.disturbances, flight.spec.seconds
        self._seed = flight.seed
        self._wires: list[SteppedWire | ImpairedWire] = []
        self._links: Sequence[Link] = ()

    @property
    def wired(self) -> bool:
        """Whether the links need wires that can be impaired."""
        return self._disturbances.link != UNDISTURBED.link

    @property
    def silence_s(self) -> float:
        """Vehicle time (s) without a message after which a vehicle counts as lost.

        With impaired links it is longer than a flight, so that lost messages never end the flight.
        """
        return SILENCE_S + (2.0 * self._seconds if self.wired else 0.0)

    def seed(self, drone: int) -> int:
        record, flight = self._seed
        return noise_seed(record, flight, drone)

    def take(self, links: Sequence[Link], wires: Sequence[SteppedWire | ImpairedWire]) -> None:
        self._links, self._wires = links, list(wires)

    def begin(self, seconds: float = math.inf) -> None:
        """Start the disturbances. The faults of the wires last for at most `seconds` of vehicle time."""
        faults = self._disturbances.link
        for wire in self._wires:
            wire.impair(faults.to_vehicle, faults.from_vehicle, seconds)
        for link in self._links:
            link.behind_us = round(faults.from_vehicle.delay_s * 1e6)
            if (hz := self._disturbances.vehicle.setpoint_hz) is not None:
                link.stream_at(hz)

    def mend(self) -> None:
        """End the disturbances of the wires. The setpoint rate stays as it is."""
        for wire in self._wires:
            wire.impair(Impairment(), Impairment(), math.inf)
        for link in self._links:
            link.behind_us = 0
