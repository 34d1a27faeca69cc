"""Defines the interface of a stage (the environment of an episode), and the parts that several kinds of stage share.

Disturbances of links, setpoint rate, air and sensors begin with the episode, so they do not change the take-off. The
disturbances of links end before the landing. A payload is a disturbance too, but it acts from boot.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dronecats.flight.logger.recorder import EstimateLoggerConfig, LoggerConfig
from dronecats.flight.processes.supervisor import ChildKind, ChildProcess, Supervisor
from dronecats.flight.sitl.config import CameraConfig, SimulatorConfig, TruthBridgeConfig, noise_seed
from dronecats.flight.spec.disturbances import UNDISTURBED, FrameFaults
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import FlightSpec, Simulated
from foundation.camera import Camera, CameraModel
from foundation.errors import DronecatsError
from foundation.run_folder import layout
from foundation.threads import DaemonExecutor
from foundation.truth import KEPT
from hil.cameras.open import PatientCamera
from hil.impairment import ImpairedWire, Impairment, SteppedWire
from hil.link.conversation import SILENCE_S
from hil.link.link import Link
from hil.link.transport import Transport, connect


class Stage:
    """Vehicles, camera, clock and logger of an episode: in one process for lockstep, over sockets in real time."""

    links: Sequence[Link]
    camera: Camera
    camera_model: CameraModel
    executor: Executor  # runs calls that may take long
    # factor on real time at which the vehicle's clock should run; None: lockstep, vehicle time waits for the agent
    speed: float | None = 1.0

    def begin(self, t0_us: int, cap_s: float) -> None:
        """Start the episode at vehicle time `t0_us` (µs), which is time zero for camera, logger and targets.

        `cap_s`: the time limit of the flight in seconds.
        """
        raise NotImplementedError

    def mend(self) -> None:
        """End the disturbances between agent and vehicles, before the order to land."""

    def end(self, reason: str, error: str | None = None) -> None:
        """Tell the logger that the episode is over."""
        raise NotImplementedError

    def tap(self, feed: Callable[[bytes], None]) -> Callable[[], None]:
        """Subscribe a function, for example of the oracle pilot, to the truth bus. The agent has no subscription.

        Returns the function that passes on the samples that have arrived. A stage without a truth bus raises
        NotImplementedError.
        """
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


SIMULATOR = ChildKind("simulator", "dronecats.flight.sitl.simulator_process:create", SimulatorConfig)
CAMERA = ChildKind("camera", "dronecats.flight.sitl.camera:CameraPart", CameraConfig)
TRUTH_BRIDGE = ChildKind("truth-bridge", "dronecats.flight.sitl.truth_bridge:TruthBridge", TruthBridgeConfig)
LOGGER = ChildKind("logger", "dronecats.flight.logger.logger_process:Logger", LoggerConfig)
ESTIMATE_LOGGER = ChildKind("estimate-logger", "dronecats.flight.logger.recorder:EstimateLogger", EstimateLoggerConfig)


class SupervisedStage(Stage):
    """Base class of stages with child processes."""

    _logger: ChildProcess

    def __init__(self, folder: Path) -> None:
        """`folder`: the episode folder, for the logs of the processes."""
        self.executor = DaemonExecutor()
        self._opened = ExitStack()  # what `close` closes, the newest first
        self._supervisor = Supervisor(folder)
        self._opened.callback(self._supervisor.close)

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._logger.do("begin", t0_us=t0_us, cap_s=cap_s)

    def end(self, reason: str, error: str | None = None) -> None:
        self._logger.do("end", reason=reason, error=error)

    def check(self) -> None:
        self._supervisor.check()

    def cause(self, error: DronecatsError) -> DronecatsError:
        return self._supervisor.cause(error)

    def close(self) -> None:
        self._opened.close()

    @contextmanager
    def _opening(self) -> Iterator[None]:
        """Close the stage if the block fails."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def _copy_links(self, ports: Sequence[int]) -> None:
        """Copy the messages of each link to a port of the logger."""
        for link, port in zip(self.links, ports, strict=True):
            copy = connect(f"udpout://127.0.0.1:{port}")
            self._opened.callback(copy.close)
            link.copy_to(copy)


class ConnectedStage(SupervisedStage):
    """The stage of a connected vehicle without ground truth."""

    camera: PatientCamera

    def __init__(self, link: Link, camera: PatientCamera, folder: Path) -> None:
        """`folder` is the episode folder, for the logs. Raises InfrastructureError."""
        super().__init__(folder)
        self.links = [link]
        self.camera, self.camera_model = camera, camera.model
        self._opened.callback(camera.close)
        self._opened.callback(link.close)
        with self._opening():
            self._logger = self._supervisor.start(ESTIMATE_LOGGER, EstimateLoggerConfig(folder=str(folder)))
            self._copy_links(self._logger.ready()["ports"])


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
    """Opens the links of simulated vehicles, and applies the flight's disturbances of links and setpoint rate."""

    def __init__(self, flight: Flight) -> None:
        self._flight, self._disturbances = flight, flight.spec.disturbances
        self._wires: Sequence[SteppedWire | ImpairedWire] = ()
        self._links: Sequence[Link] = ()

    @property
    def wired(self) -> bool:
        """Whether the links need wires that can be impaired."""
        return self._disturbances.link != UNDISTURBED.link

    def seed(self, drone: int) -> int:
        record, flight = self._flight.seed
        return noise_seed(record, flight, drone)

    def open(
        self, transports: Sequence[Transport], wires: Sequence[SteppedWire | ImpairedWire], *, px4: bool
    ) -> Sequence[Link]:
        """Return the link to each vehicle. `wires`: the connections that can be impaired."""
        spec = self._flight.spec
        # with impaired links, the allowed silence is longer than a flight, so that lost messages never end the flight
        silence_s = SILENCE_S + (2.0 * spec.seconds if self.wired else 0.0)
        self._wires = wires
        self._links = [
            Link(transport, silence_s=silence_s, limits=spec.envelope, simulated=True) for transport in transports
        ]
        if self._flight.camera_model.gimballed and not px4:  # PX4 does not drive the simulated gimbal
            for link in self._links:
                link.watch_gimbal()
        return self._links

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
