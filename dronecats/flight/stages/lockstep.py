"""The lockstep stage: the simulated parts around the agent, with one clock that waits for the slowest part.

All parts except PX4 are in one process.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from dronecats.flight.logger.logger_process import measured_in, subscribe
from dronecats.flight.logger.recorder import Recorder
from dronecats.flight.sitl.camera import WorldCamera
from dronecats.flight.sitl.lockstep import Lockstep, Px4Lockstep
from dronecats.flight.sitl.px4 import Px4Simulator
from dronecats.flight.sitl.simulation import SimulatedVehicle, VehiclePort, build, origin
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Simulated
from dronecats.flight.stages.stage import DisturbedLinks, simulator_config, truth_kept
from episodes.world.world import World
from foundation.errors import DronecatsError
from foundation.mavlink import dialect
from foundation.threads import InlineExecutor
from hil.link.link import Link

SPARE_S = 1.0  # s; link faults outlast the flight's time limit by this: the agent may still wait for telemetry


class LockstepStage:
    """A stage with the same parts as in real time, without sockets between them."""

    lockstep = True
    speed = None

    def __init__(self, flight: Flight, simulated: Simulated, folder: Path, world: World) -> None:
        """`folder`: the episode folder, for the logs. Raises UsageError, InfrastructureError."""
        spec, camera = flight.spec, flight.camera_model
        self.camera_model = camera
        self._px4: Px4Simulator | None = None
        clock: Lockstep | Px4Lockstep
        ours: tuple[SimulatedVehicle, ...] = ()  # the vehicles with the project's autopilot
        if simulated.autopilot == "px4":
            self._px4 = Px4Simulator(simulator_config(flight.spec, simulated, folder), world=world)
            clock = Px4Lockstep(self._px4)
        else:
            clock = Lockstep(
                build(world, airframe=simulated.airframe, seed=spec.seed, disturbances=spec.disturbances.vehicle)
            )
            ours = clock.simulation.vehicles
        self._clock, self._simulation = clock, clock.simulation
        self._recorder = Recorder(folder, origin(world), measured_in(world), camera)
        clock.follow(self._recorder.truth)
        for vehicle in ours:
            port = vehicle.open_port("minimal")
            subscribe(port.receive, vehicle.index + 1)
            clock.followers.append(partial(self._log, port, vehicle.index))
        self.camera = WorldCamera(
            world, camera, lambda data: announce(data), rendered=simulated.rendered, optics=flight.optics,
            seed=spec.seed, kept=truth_kept(spec.disturbances.frame), depth=simulated.camera == "depth",
        )  # fmt: skip
        announce = clock.follow(self.camera.feed)
        self.camera.warm_up()
        drones = range(len(self._simulation.vehicles))
        self._disturbed = disturbed = DisturbedLinks(flight)
        if disturbed.wired:
            wires = [clock.wire(index, disturbed.seed(index)) for index in drones]
            self.links = [
                Link(wire, silence_s=disturbed.silence_s, limits=spec.envelope, simulated=True) for wire in wires
            ]
            disturbed.take(self.links, wires)
        else:
            self.links = [Link(clock.transport(index), limits=spec.envelope, simulated=True) for index in drones]
            disturbed.take(self.links, ())
        if camera.gimballed and not self._px4:  # PX4 does not drive the simulated gimbal
            for link in self.links:
                link.watch_gimbal()
        if self._px4:
            for drone, link in enumerate(self.links):
                link.listeners.append(partial(self._keep, drone))
        self.executor: Executor = InlineExecutor()

    def _log(self, port: VehiclePort, drone: int) -> None:
        self._recorder.telemetry(port.take(), drone)

    def _keep(self, drone: int, message: dialect.MAVLink_message) -> None:
        self._recorder.telemetry(bytes(message.get_msgbuf()), drone)

    def tap(self, feed: Callable[[bytes], None]) -> "FedTap":
        """Feed the truth bus to a function after every tick."""
        self._clock.follow(feed)
        return FedTap()

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._simulation.begin(t0_us)
        self._recorder.begin(t0_us, cap_s)
        self.camera.begin(t0_us)
        self._disturbed.begin(cap_s + SPARE_S)

    def mend(self) -> None:
        self._disturbed.mend()

    def end(self, reason: str, error: str | None = None) -> None:
        self._recorder.end(reason, error)

    def check(self) -> None:
        """Do nothing: in one process, errors raise by themselves."""

    def check_vehicles(self) -> None:
        """Do nothing: in one process, errors raise by themselves."""

    def cause(self, error: DronecatsError) -> DronecatsError:
        return error

    def close(self) -> None:
        self._recorder.close()
        self.camera.close()
        if self._px4:
            for link in self.links:
                link.close()
            self._px4.close()


class FedTap:
    """A subscription whose function gets the new bytes at every tick."""

    def drain(self) -> None:
        """Do nothing: the samples have been processed at each tick."""

    def close(self) -> None:
        pass
