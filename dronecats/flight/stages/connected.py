"""The stage (the parts around the agent) of a connected vehicle, which this program does not simulate.

The parts are the link, the camera, and a logger of the autopilot's estimate.
"""

from pathlib import Path

from dronecats.flight.logger.estimate_process import EstimateLoggerConfig
from dronecats.flight.processes.supervisor import ChildProcess, Supervisor
from dronecats.flight.stages.stage import ESTIMATE_LOGGER
from foundation.errors import DronecatsError
from foundation.threads import DaemonExecutor
from hil.cameras.open import PatientCamera
from hil.link.link import Link
from hil.link.transport import connect


class SupervisedStage:
    """Base class of stages with child processes. Its defaults are for a connected vehicle, which has its own clock."""

    lockstep = False
    speed: float | None = 1.0
    _supervisor: Supervisor
    _logger: ChildProcess

    def mend(self) -> None:
        """Do nothing, because a connected vehicle has no disturbances."""

    def end(self, reason: str, error: str | None = None) -> None:
        self._logger.do("end", reason=reason, error=error)

    def check(self) -> None:
        self._supervisor.check()

    def check_vehicles(self) -> None:
        """Do nothing, because there is no simulator."""

    def cause(self, error: DronecatsError) -> DronecatsError:
        return self._supervisor.cause(error)


class ConnectedStage(SupervisedStage):
    """A stage without ground truth. The link's bytes are copied to the logger, which is a separate process."""

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
