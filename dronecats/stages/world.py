"""A vehicle that somebody else simulates, in our world: frames drawn and truth measured at its true pose."""

from collections.abc import Callable
from pathlib import Path

from dronecats.agent.latency import DaemonExecutor
from dronecats.pilots.bus_oracle import BusOracle
from dronecats.processes.supervisor import Supervisor
from dronecats.run.terms import FRAMES_S, Terms
from dronecats.stages import parts
from dronecats.stages.realtime import Copy, Patience
from dronecats.stages.served_pilot import asked, served
from episodes.world import World
from foundation.camera import CameraModel
from hil.cameras.patient import PatientCamera
from hil.cameras.snapshot import HttpCamera
from hil.link.link import Link
from hil.link.transport import connect


class WorldStage:
    """The truth comes over a bridge onto a bus of our own, where camera, logger and oracle listen as they always do."""

    def __init__(
        self,
        link: Link,
        episode: str,
        world: World,
        truth: str,
        agreed: Terms,
        folder: Path,
        say: Callable[[str], None],
        *,
        judged: bool,
    ) -> None:
        """`truth` is the URL of the vehicle's true poses; the first of them is where the episode's start stands.

        Not `judged`: the logger keeps what the autopilot says, as of any connected vehicle.
        """
        self._supervisor = Supervisor(folder)
        self.executor = DaemonExecutor()
        self.links = [link]
        self.camera_model = CameraModel()
        try:
            self._start(episode, world, truth, agreed, folder, say, judged)
        except BaseException:
            self.close()
            raise

    def _start(
        self,
        episode: str,
        world: World,
        truth: str,
        agreed: Terms,
        folder: Path,
        say: Callable[[str], None],
        judged: bool,
    ) -> None:
        patience, link, pilot = Patience(say), self.links[0], agreed.pilot
        process = served(self._supervisor, pilot)
        bridge = self._supervisor.start(parts.TRUTH_BRIDGE, {"episode": episode, "truth": truth}).ready(patience)
        self.yaw: float = bridge["yaw"]  # rad, of the vehicle as it stands, which is the episode's first heading
        bus = f"udpout://127.0.0.1:{bridge['truth']}"
        self._camera_process = self._supervisor.start(parts.CAMERA, {"episode": episode, "truth": bus, "optics": None})
        if judged:
            self._copy = Copy(link)
            telemetry = [f"udpout://127.0.0.1:{self._copy.port}"]
            self._logger = self._supervisor.start(
                parts.LOGGER, {"episode": episode, "folder": str(folder), "truth": bus, "telemetry": telemetry}
            )
        else:
            self._logger = self._supervisor.start(parts.ESTIMATE_LOGGER, {"folder": str(folder)})
        url = self._camera_process.ready(patience)["url"]
        camera = HttpCamera(url, lambda: link.time_us, max_age_s=agreed.limits.frame_s)
        self.camera = PatientCamera(camera, FRAMES_S, lambda fault: say(f"      holding: {fault}"))
        heard = self._logger.ready(patience)
        if judged:
            self._copy.begin()
        else:
            self._wire = connect(f"udpout://127.0.0.1:{heard['port']}")
            link.listeners.append(lambda message: self._wire.send(bytes(message.get_msgbuf())))
        self.model = (
            BusOracle(world, bus)
            if pilot == "oracle"
            else asked(pilot, process, agreed.model, agreed.base_url, patience)
        )

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._camera_process.do("begin", t0_us=t0_us)
        self._logger.do("begin", t0_us=t0_us, cap_s=cap_s)
        if isinstance(self.model, BusOracle):
            self.model.begin(t0_us)

    def end(self, reason: str, error: str | None = None) -> None:
        self._logger.do("end", reason=reason, error=error)

    def check(self) -> None:
        self._supervisor.check()

    def close(self) -> None:
        for part in ("model", "camera", "_copy", "_wire"):
            if getattr(self, part, None) is not None:
                getattr(self, part).close()
        self.links[0].close()
        self._supervisor.close()
