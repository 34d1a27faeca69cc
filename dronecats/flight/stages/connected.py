"""The stage of a connected vehicle, which this program does not simulate.

A stage is everything around the agent: here the link, the camera, and a logger of the autopilot's estimate.
"""

from pathlib import Path

from dronecats.flight.logger.estimate_process import EstimateLoggerConfig
from dronecats.flight.processes.supervisor import ChildProcess, Supervisor
from dronecats.flight.stages.stage import ESTIMATE_LOGGER, Stage
from foundation.errors import DronecatsError
from foundation.threads import DaemonExecutor
from hil.cameras.open import PatientCamera
from hil.link.link import Link
from hil.link.transport import connect


class SupervisedStage(Stage):
    """Base class of stages with child processes."""

    _supervisor: Supervisor
    _logger: ChildProcess

    def end(self, reason: str, error: str | None = None) -> None:
        self._logger.do("end", reason=reason, error=error)

    def check(self) -> None:
        self._supervisor.check()

    def cause(self, error: DronecatsError) -> DronecatsError:
        return self._supervisor.cause(error)


class ConnectedStage(SupervisedStage):
    """A stage without ground truth. The link's bytes are copied to the logger, which is a separate process."""

    camera: PatientCamera

    def __init__(self, link: Link, camera: PatientCamera, folder: Path) -> None:
        """`folder` is the episode folder, for the logs. Raises InfrastructureError."""
        self._supervisor = Supervisor(folder)
        self.executor = DaemonExecutor()
        self.links = [link]
        self.camera, self.camera_model = camera, camera.model
        try:
            self._logger = self._supervisor.start(ESTIMATE_LOGGER, EstimateLoggerConfig(folder=str(folder)))
            self._copy = connect(f"udpout://127.0.0.1:{self._logger.ready()['port']}")
            link.copy_to(self._copy)
        except BaseException:
            self.close()
            raise

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._logger.do("begin", t0_us=t0_us, cap_s=cap_s)

    def close(self) -> None:
        for link in self.links:
            link.close()
        self.camera.close()
        if hasattr(self, "_copy"):
            self._copy.close()
        self._supervisor.close()
