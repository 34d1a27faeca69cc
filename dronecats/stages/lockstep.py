"""Everything in one process on one clock that waits for whoever is slowest."""

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from dronecats.agent.latency import InlineExecutor
from dronecats.agent.models.model import Model
from dronecats.agent.models.openai_chat import ChatModel
from dronecats.agent.models.providers import PROVIDERS, split
from dronecats.logger.recorder import Recorder
from dronecats.logger.telemetry import subscribe
from dronecats.logger.world_measure import measured_in
from dronecats.pilots import roster
from dronecats.pilots.oracle_model import OracleModel
from dronecats.pilots.server import PilotServer
from dronecats.run.plan import Plan
from dronecats.sitl.camera import WorldCamera
from dronecats.sitl.lockstep import Lockstep
from dronecats.sitl.px4.lockstep import Px4Lockstep
from dronecats.sitl.px4.simulator import Px4Simulator
from dronecats.sitl.scenario import build, origin
from dronecats.sitl.simulation import SimulatedVehicle
from dronecats.sitl.vehicle_port import VehiclePort
from episodes.world import World
from foundation.camera import CameraModel
from foundation.mavlink import dialect
from hil.link.link import Link


class LockstepStage:
    """The same parts as in real time, without the sockets between them; the pilot keeps its HTTP endpoint."""

    def __init__(self, plan: Plan, folder: Path, world: World) -> None:
        camera = self.camera_model = CameraModel()
        self._px4: Px4Simulator | None = None
        clock: Lockstep | Px4Lockstep
        ours: tuple[SimulatedVehicle, ...] = ()  # the vehicles with our autopilot
        if plan.autopilot == "px4":
            self._px4 = px4_simulator(plan, folder, world)
            clock = Px4Lockstep(self._px4)
        else:
            clock = Lockstep(build(world, airframe=plan.airframe, seed=plan.seed))
            ours = clock.simulation.vehicles
        self._simulation = clock.simulation
        self._recorder = Recorder(folder, origin(world), measured_in(world), camera)
        clock.follow(self._recorder.truth)
        for vehicle in ours:
            port = vehicle.open_port("minimal")
            subscribe(port.receive, vehicle.index + 1)
            clock.followers.append(partial(self._log, port))
        self.camera = WorldCamera(
            world, camera, lambda data: announce(data), rendered=plan.rendered, optics=plan.optics
        )
        announce = clock.follow(self.camera.feed)
        self.camera.warm_up()
        self._server: PilotServer | None = None
        self._oracle: OracleModel | None = None
        self.model = self._model(plan, world, camera, clock)
        drones = range(len(self._simulation.vehicles))
        self.links = [Link(clock.transport(index), limits=plan.limits, simulated=True) for index in drones]
        if self._px4:
            for link in self.links:
                link.listeners.append(self._keep)
        self.executor: Executor = InlineExecutor()

    def _log(self, port: VehiclePort) -> None:
        self._recorder.telemetry(port.take())

    def _keep(self, message: dialect.MAVLink_message) -> None:
        self._recorder.telemetry(bytes(message.get_msgbuf()))

    def _model(self, plan: Plan, world: World, camera: CameraModel, clock: Lockstep | Px4Lockstep) -> Model:
        if plan.pilot == "oracle":
            self._oracle = OracleModel(world, camera, origin(world), lambda: None)
            clock.follow(self._oracle.feed)
            return self._oracle
        if plan.pilot:
            self._server = PilotServer(roster.answer(plan.pilot), plan.pilot, owned_by=roster.owner(plan.pilot)).start()
            return ChatModel(PROVIDERS["local"], plan.pilot, self._server.base_url)
        return ChatModel(*split(plan.model or ""), plan.base_url)

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._simulation.begin(t0_us)
        self._recorder.begin(t0_us, cap_s)
        self.camera.begin(t0_us)
        if self._oracle:
            self._oracle.begin(t0_us)

    def end(self, reason: str, error: str | None = None) -> None:
        self._recorder.end(reason, error)

    def check(self) -> None:
        """One process: what breaks raises by itself."""

    def close(self) -> None:
        self.model.close()
        if self._server:
            self._server.close()
        self._recorder.close()
        if self._px4:
            for link in self.links:
                link.close()
            self._px4.close()


def px4_simulator(plan: Plan, folder: Path, world: World) -> Px4Simulator:
    """Return the simulator of a plan's vehicles under PX4, which nobody paces. Raises UsageError."""
    config = {
        "episode": plan.episode,
        "airframe": plan.airframe,
        "seed": plan.seed,
        "speed": None,
        "px4": plan.px4,
        "log_dir": str(folder),
    }
    return Px4Simulator(config, world=world)
