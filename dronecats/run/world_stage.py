"""A vehicle that somebody else simulates, in our world: frames drawn and truth measured at its true pose."""

from collections.abc import Callable
from pathlib import Path

from dronecats.agent.chat import ChatModel
from dronecats.agent.latency import DaemonExecutor
from dronecats.agent.model import Model
from dronecats.agent.providers import PROVIDERS, split
from dronecats.border.camera import CameraModel
from dronecats.pilots.oracle_model import OracleModel
from dronecats.run.listening import Listener
from dronecats.run.realtime_stage import Copy, Patience
from dronecats.run.supervisor import ChildProcess, Supervisor
from dronecats.sitl.scenario import origin
from episodes.world import World
from hil.cameras.patient import PatientCamera
from hil.cameras.snapshot import HttpCamera
from hil.link import Link

FRAMES_S = 10.0  # wall seconds without a fresh frame after which the flight ends


class WorldStage:
    """The truth comes over a bridge onto a bus of our own, where camera, logger and oracle listen as they always do."""

    def __init__(
        self,
        link: Link,
        episode: str,
        world: World,
        truth: str,
        pilot: str | None,
        model: str | None,
        base_url: str | None,
        folder: Path,
        say: Callable[[str], None],
    ) -> None:
        self._supervisor = Supervisor(folder)
        self._oracle: OracleModel | None = None
        self._oracle_bus: Listener | None = None
        self.executor = DaemonExecutor()
        self.links = [link]
        self.camera_model = CameraModel()
        try:
            self._start(episode, world, truth, pilot, model, base_url, folder, say)
        except BaseException:
            self.close()
            raise

    def _start(
        self,
        episode: str,
        world: World,
        truth: str,
        pilot: str | None,
        model: str | None,
        base_url: str | None,
        folder: Path,
        say: Callable[[str], None],
    ) -> None:
        patience, link = Patience(say), self.links[0]
        served = self._supervisor.start("pilot", {"pilot": pilot}) if pilot not in (None, "oracle") else None
        bridge = self._supervisor.start("truth-bridge", {"episode": episode, "truth": truth}).ready(patience)
        self.yaw: float = bridge["yaw"]  # rad, of the vehicle as it stands, which is the episode's first heading
        bus = f"udpout://127.0.0.1:{bridge['truth']}"
        self._camera_process = self._supervisor.start("camera", {"episode": episode, "truth": bus, "optics": None})
        self._copy = Copy(link)
        telemetry = [f"udpout://127.0.0.1:{self._copy.port}"]
        self._logger = self._supervisor.start(
            "logger", {"episode": episode, "folder": str(folder), "truth": bus, "telemetry": telemetry}
        )
        camera = HttpCamera(self._camera_process.ready(patience)["url"], lambda: link.time_us, max_age_s=1.0)
        self.camera = PatientCamera(camera, FRAMES_S, lambda fault: say(f"      holding: {fault}"))
        self._logger.ready(patience)
        self._copy.begin()
        self.model = self._model(pilot, model, base_url, served, world, bus, patience)

    def _model(
        self,
        pilot: str | None,
        model: str | None,
        base_url: str | None,
        served: ChildProcess | None,
        world: World,
        bus: str,
        patience: Callable[[], None],
    ) -> Model:
        if pilot == "oracle":
            self._oracle = OracleModel(world, self.camera_model, origin(world), self._listen)
            self._oracle_bus = Listener(bus, self._oracle.feed)
            return self._oracle
        if served is not None:
            return ChatModel(PROVIDERS["local"], pilot or "", served.ready(patience)["base_url"])
        return ChatModel(*split(model or ""), base_url)

    def _listen(self) -> None:
        while self._oracle_bus and self._oracle_bus.read(0.0):
            pass

    def begin(self, t0_us: int) -> None:
        self._camera_process.do("begin", t0_us=t0_us)
        self._logger.do("begin", t0_us=t0_us)
        if self._oracle:
            self._oracle.begin(t0_us)

    def end(self, reason: str, error: str | None = None) -> None:
        self._logger.do("end", reason=reason, error=error)

    def check(self) -> None:
        self._supervisor.check()

    def close(self) -> None:
        for part in ("model", "camera", "_copy", "_oracle_bus"):
            if getattr(self, part, None) is not None:
                getattr(self, part).close()
        self.links[0].close()
        self._supervisor.close()
