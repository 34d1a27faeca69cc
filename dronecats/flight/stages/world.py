"""A vehicle that somebody else simulates, in our world: frames drawn and truth measured at its true pose."""

from collections.abc import Callable
from pathlib import Path

from dronecats.agent.model_call import DaemonExecutor
from dronecats.flight.logger.config import EstimateLoggerConfig, LoggerConfig
from dronecats.flight.processes.bus_listener import Listener
from dronecats.flight.processes.supervisor import Supervisor
from dronecats.flight.sitl.config import CameraConfig, TruthBridgeConfig
from dronecats.flight.sitl.truth_bridge import Placement
from dronecats.flight.stages import parts
from dronecats.flight.stages.connected import VehicleStage
from dronecats.flight.stages.realtime import Copy, Patience
from foundation.camera import CameraModel
from hil.cameras.http import HttpCamera
from hil.cameras.open import FRAMES_S, PatientCamera
from hil.link.link import Link
from hil.link.transport import connect


class WorldStage(VehicleStage):
    """The truth comes over a bridge onto a bus of our own, where camera, logger and oracle listen as they always do."""

    def __init__(
        self,
        link: Link,
        record: Path,
        truth: str,
        folder: Path,
        say: Callable[[str], None],
        *,
        frame_s: float,
        judged: bool,
    ) -> None:
        """`truth` is the URL of the vehicle's true poses; the first of them is where the record's start stands.

        `folder` is the episode's, for the logs; `frame_s`: the age of a frame on which nothing is decided any more.
        Not `judged`: the logger keeps what the autopilot says, as of any connected vehicle.
        Raises UsageError, InfrastructureError.
        """
        self._supervisor = Supervisor(folder)
        self.executor = DaemonExecutor()
        self.links = [link]
        self.camera_model = CameraModel()
        try:
            self._start(str(record), truth, str(folder), say, frame_s, judged)
        except BaseException:
            self.close()
            raise

    def _start(
        self, episode: str, truth: str, folder: str, say: Callable[[str], None], frame_s: float, judged: bool
    ) -> None:
        patience, link = Patience(say), self.links[0]
        bridge = self._supervisor.start(parts.TRUTH_BRIDGE, TruthBridgeConfig(episode=episode, truth=truth))
        told = bridge.ready(patience)
        self.placement = Placement(**told["placement"])
        bus = self._bus = f"udpout://127.0.0.1:{told['truth']}"
        self._camera_process = self._supervisor.start(parts.CAMERA, CameraConfig(episode=episode, truth=bus))
        if judged:
            self._copy = Copy(link)
            telemetry = (f"udpout://127.0.0.1:{self._copy.port}",)
            self._logger = self._supervisor.start(
                parts.LOGGER, LoggerConfig(episode=episode, folder=folder, truth=bus, telemetry=telemetry)
            )
        else:
            self._logger = self._supervisor.start(parts.ESTIMATE_LOGGER, EstimateLoggerConfig(folder=folder))
        url = self._camera_process.ready(patience)["url"]
        camera = HttpCamera(url, lambda: link.time_us, max_age_s=frame_s)
        self.camera = PatientCamera(camera, FRAMES_S, lambda fault: say(f"      holding: {fault}"))
        heard = self._logger.ready(patience)
        if judged:
            self._copy.begin()
        else:
            self._wire = connect(f"udpout://127.0.0.1:{heard['port']}")
            link.listeners.append(lambda message: self._wire.send(bytes(message.get_msgbuf())))

    def tap(self, feed: Callable[[bytes], None]) -> Listener:
        """Have the truth bus fed to somebody, who reads it."""
        return Listener(self._bus, feed)

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._camera_process.do("begin", t0_us=t0_us)
        self._logger.do("begin", t0_us=t0_us, cap_s=cap_s)

    def close(self) -> None:
        for part in ("camera", "_copy", "_wire"):
            if getattr(self, part, None) is not None:
                getattr(self, part).close()
        self.links[0].close()
        self._supervisor.close()
