"""Stages (the parts around the agent) with child processes.

`RealtimeStage` is for the project's simulator, `WorldStage` for a vehicle that an external simulator moves.
"""

import time
from collections.abc import Callable
from pathlib import Path

from dronecats.flight.logger.recorder import COPIED, EstimateLoggerConfig, LoggerConfig
from dronecats.flight.processes.supervisor import ChildProcess
from dronecats.flight.sitl.config import CameraConfig, TruthBridgeConfig
from dronecats.flight.sitl.episode_world import Placement
from dronecats.flight.sitl.truth_listener import Listener
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Simulated
from dronecats.flight.stages.stage import (
    CAMERA,
    ESTIMATE_LOGGER,
    LOGGER,
    SIMULATOR,
    TRUTH_BRIDGE,
    DisturbedLinks,
    SupervisedStage,
    simulator_config,
    truth_kept,
)
from foundation.camera import CameraModel
from hil.cameras.http import HttpCamera
from hil.cameras.open import FRAMES_S, PatientCamera
from hil.impairment import PERFECT, ImpairedWire
from hil.link.link import Link
from hil.link.transport import Transport, UdpTransport, connect


class TruthBusStage(SupervisedStage):
    """Base class of stages with a truth bus between their processes."""

    _truth: str  # URL of the truth bus
    _camera_process: ChildProcess

    def tap(self, feed: Callable[[bytes], None]) -> Callable[[], None]:
        listener = Listener(self._truth, feed)
        self._opened.callback(listener.close)
        return listener.drain

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._camera_process.do("begin", t0_us=t0_us)
        super().begin(t0_us, cap_s)


class RealtimeStage(TruthBusStage):
    """Simulator, camera and logger as supervised processes, on free ports."""

    camera: HttpCamera

    def __init__(self, flight: Flight, simulated: Simulated, folder: Path, notify: Callable[[str], None]) -> None:
        """`folder`: the episode folder, with the record. Raises UsageError, InfrastructureError."""
        super().__init__(folder)
        self.speed = simulated.speed
        self._wires: list[ImpairedWire] = []
        self.camera_model = flight.camera_model
        with self._opening():
            patience, px4 = Patience(notify), simulated.autopilot == "px4"
            config = simulator_config(flight.spec, simulated, folder)
            simulator = self._simulator = self._supervisor.start(SIMULATOR, config)
            ports = simulator.ready(patience)
            self._truth = f"udpout://127.0.0.1:{ports['truth']}"
            direction = "udpin" if px4 else "udpout"  # PX4 sends first, to a fixed port
            self._disturbed = DisturbedLinks(flight)
            transports = [
                self._transport(f"{direction}://127.0.0.1:{port}", drone, speaks_first=px4)
                for drone, port in enumerate(ports["agent"])
            ]
            self.links = self._disturbed.open(transports, self._wires, px4=px4)
            for link in self.links:
                self._opened.callback(link.close)
            camera = self._camera_process = self._supervisor.start(
                CAMERA,
                CameraConfig(
                    episode=config.episode,
                    airframe=config.airframe,
                    truth=self._truth,
                    optics=simulated.optics,
                    conditions=flight.spec.disturbances.conditions.of_map,
                    seed=config.seed,
                    kept=truth_kept(flight.spec.disturbances.frame),
                ),
            )
            telemetry = tuple(f"udpout://127.0.0.1:{port}" for port in ports["log"])
            if px4:  # PX4 has no free MAVLink port for the logger
                self._await_px4(ports["px4"], notify)
                telemetry = (COPIED,) * len(self.links)
            self._logger = self._supervisor.start(
                LOGGER,
                LoggerConfig(
                    episode=config.episode,
                    airframe=config.airframe,
                    folder=str(folder),
                    truth=self._truth,
                    telemetry=telemetry,
                ),
            )
            served = camera.ready(patience)
            self.camera = HttpCamera(
                served["reduced"],
                lambda: self.links[0].time_us,
                depth_url=served["depth"] if simulated.camera == "depth" else None,
            )
            self._opened.callback(self.camera.close)
            listening = self._logger.ready(patience)["ports"]
            if px4:
                self._copy_links(listening)

    def _transport(self, url: str, drone: int, *, speaks_first: bool) -> Transport:
        """Return the agent's end of a vehicle's MAVLink connection, through an ImpairedWire if links are disturbed."""
        if not self._disturbed.wired:
            return connect(url)
        ends = UdpTransport("udpin://127.0.0.1:0", "127.0.0.1", 0, listen=True)
        far = connect(f"udpout://127.0.0.1:{ends.port}")
        # `ends` learns the address of `far` from the first datagram, so `far` belongs to the side that speaks first
        agent, near = (ends, far) if speaks_first else (far, ends)
        speed = self.speed or 1.0
        seed = self._disturbed.seed(drone)
        wire = ImpairedWire(near, connect(url), PERFECT, PERFECT, seed, lambda: time.monotonic() * speed)
        self._wires.append(wire.start())
        self._opened.callback(wire.close)
        return agent

    def _await_px4(self, ports: list[int], notify: Callable[[str], None]) -> None:
        """Wait until each vehicle has a PX4 that answers and has opened its MAVLink ports.

        Raises InfrastructureError if a started PX4 ends.
        """
        notify(f"waiting for PX4 on TCP port {', '.join(map(str, ports))} …")
        while not self._simulator.do("in step"):
            self._supervisor.check()
            time.sleep(0.1)
        for link in self.links:
            while not link.transport.receive(0.5):
                self._supervisor.check()

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._simulator.do("begin", t0_us=t0_us)
        super().begin(t0_us, cap_s)
        self._disturbed.begin()

    def mend(self) -> None:
        self._disturbed.mend()

    def pace(self) -> dict[str, float]:
        """Return how well the simulator kept real time (`RateKeeper.figures`). Raises InfrastructureError."""
        return dict(self._simulator.do("pace"))

    def check(self) -> None:
        super().check()
        for wire in self._wires:
            wire.check()

    def check_vehicles(self) -> None:
        self._simulator.check()


class Patience:
    """Prints one line if a wait takes 3 s. `ChildProcess.ready` calls it twice a second."""

    def __init__(self, notify: Callable[[str], None]) -> None:
        self._notify, self._waits = notify, 0

    def __call__(self) -> None:
        self._waits += 1
        if self._waits == 6:
            from dronecats.flight.sitl import compile_ahead

            self._notify(f"starting simulator and camera{compile_ahead.compile_notice()} …")


class WorldStage(TruthBusStage):
    """A stage for a vehicle that an external simulator moves, in an episode's world.

    A bridge copies the vehicle's true poses to a truth bus for camera, logger and oracle.
    """

    def __init__(
        self,
        link: Link,
        record: Path,
        truth: str,
        folder: Path,
        notify: Callable[[str], None],
        *,
        frame_s: float,
        judged: bool,
    ) -> None:
        """`truth`: URL of the vehicle's true poses; a transform maps the first pose to the start in the file `record`.

        `folder`: the episode folder, for the logs; `frame_s`: largest age of a frame that a decision may use.
        `judged` False: the logger writes the autopilot's estimate, as for other connected vehicles.
        Raises UsageError, InfrastructureError.
        """
        super().__init__(folder)
        self.links = [link]
        self._opened.callback(link.close)
        self.camera_model = CameraModel()
        with self._opening():
            patience = Patience(notify)
            bridge = self._supervisor.start(TRUTH_BRIDGE, TruthBridgeConfig(episode=str(record), truth=truth))
            ports = bridge.ready(patience)
            self.placement = Placement(**ports["placement"])
            bus = self._truth = f"udpout://127.0.0.1:{ports['truth']}"
            self._camera_process = self._supervisor.start(CAMERA, CameraConfig(episode=str(record), truth=bus))
            if judged:
                self._logger = self._supervisor.start(
                    LOGGER, LoggerConfig(episode=str(record), folder=str(folder), truth=bus, telemetry=(COPIED,))
                )
            else:
                self._logger = self._supervisor.start(ESTIMATE_LOGGER, EstimateLoggerConfig(folder=str(folder)))
            url = self._camera_process.ready(patience)["reduced"]
            camera = HttpCamera(url, lambda: link.time_us, max_age_s=frame_s)
            self.camera = PatientCamera(camera, FRAMES_S, lambda fault: notify(f"      holding: {fault}"))
            self._opened.callback(self.camera.close)
            self._copy_links(self._logger.ready(patience)["ports"])
