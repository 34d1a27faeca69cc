"""Lockstep: vehicle time advances only while a client waits for data. `LockstepStage` runs a whole flight this way.

All parts except PX4 are in one process and exchange MAVLink bytes without sockets. With the project's autopilot a
flight is deterministic.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Generic

from dronecats.flight.logger.logger_process import measured_in, subscribe
from dronecats.flight.logger.recorder import Recorder
from dronecats.flight.sitl.camera import WorldCamera
from dronecats.flight.sitl.config import AIRFRAME, SimulatorConfig
from dronecats.flight.sitl.episode_world import origin
from dronecats.flight.sitl.px4 import Px4Simulator, Px4Vehicle
from dronecats.flight.sitl.simulation import SimulatedVehicle, Simulation, V, VehiclePort, build
from dronecats.flight.sitl.sockets import AGENT_PORT
from dronecats.flight.spec.disturbances import VehicleFaults
from dronecats.flight.spec.flight import Flight
from dronecats.flight.spec.flight_spec import Simulated
from dronecats.flight.stages.stage import DisturbedLinks, Stage, simulator_config, truth_kept
from episodes.world.world import World
from foundation.mavlink import dialect
from foundation.threads import InlineExecutor
from hil.impairment import SteppedWire
from hil.link.transport import MemoryTransport, Transport, UdpTransport, connect


class TurnOrder(ABC, Generic[V]):
    """Advances the simulation by one tick, then calls the followers, which read the new bytes."""

    def __init__(self, simulation: Simulation[V]) -> None:
        self.simulation = simulation
        self.followers: list[Callable[[], None]] = []

    def pump(self) -> None:
        self.simulation.advance()
        for follower in self.followers:
            follower()

    @abstractmethod
    def transport(self, vehicle: int) -> Transport:
        """Return the agent's end of the MAVLink connection to one vehicle's autopilot."""

    @abstractmethod
    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        """Return the agent's end of a connection that can delay and lose messages; `seed` seeds the random faults."""

    def now_s(self) -> float:
        return self.simulation.time_us / 1e6

    def follow(self, feed: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Call `feed` with new bytes of the truth bus after every tick; return the function that sends on the bus."""
        tap = self.simulation.bus.tap()

        def follow_on() -> None:
            data = tap.take()
            if data:
                feed(data)

        self.followers.append(follow_on)
        return tap.receive


class Lockstep(TurnOrder[SimulatedVehicle]):
    """The turn order of vehicles with the project's autopilot."""

    def transport(self, vehicle: int, profile: str = "minimal") -> Transport:
        """Return the agent's end of a vehicle's MAVLink port; profile `minimal` streams only requested messages."""
        port = self.simulation.vehicles[vehicle].open_port(profile)
        return MemoryTransport(f"lockstep://{vehicle}", port.take, port.receive, self.pump, self.now_s)

    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        port = self.simulation.vehicles[vehicle].open_port("minimal")
        wire = SteppedWire(f"lockstep://{vehicle}", port.take, port.receive, self.pump, self.now_s, seed)
        self.followers.append(wire.step)
        return wire


MOMENT_S = 0.002  # wall seconds to wait for PX4's ATTITUDE, which mostly arrives within 0.3 ms of a tick


class Px4Lockstep(TurnOrder[Px4Vehicle]):
    """The turn order of vehicles with PX4, whose MAVLink still uses sockets."""

    def __init__(self, simulator: Px4Simulator) -> None:
        """Wait until every vehicle has a PX4 that answers. Raises InfrastructureError if a started PX4 ends."""
        super().__init__(simulator.simulation)
        self._simulator = simulator
        while not simulator.do("in step", {}):
            simulator.turn()

    def pump(self) -> None:
        """Advance by one tick of vehicle time, or wait briefly for a PX4 that has not connected yet."""
        self._simulator.turn()
        for follower in self.followers:
            follower()

    def transport(self, vehicle: int) -> "PumpedTransport":
        """Return the offboard link of one vehicle's PX4. Raises UsageError if the port is in use."""
        return PumpedTransport(self._port(vehicle), self)

    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        socket = connect(f"udpin://127.0.0.1:{self._port(vehicle)}")
        wire = SteppedWire(
            socket.url, lambda: socket.receive(0.0), socket.send, self.pump, self.now_s, seed, socket.close
        )
        self.followers.append(lambda: wire.step(socket.receive(MOMENT_S)))
        return wire

    def _port(self, vehicle: int) -> int:
        return AGENT_PORT + self._simulator.instance + vehicle


class PumpedTransport(UdpTransport):
    """A socket that advances vehicle time while a read waits for data."""

    def __init__(self, port: int, clock: Px4Lockstep) -> None:
        super().__init__(f"udpin://127.0.0.1:{port}", "127.0.0.1", port, listen=True)
        self._clock = clock

    def receive(self, timeout_s: float) -> bytes:
        data = super().receive(0.0)
        due_s = time.monotonic() + timeout_s  # wall time, so that the wait ends if PX4 has gone
        while not data and time.monotonic() < due_s:
            self._clock.pump()
            data = super().receive(MOMENT_S)
        return data


@contextmanager
def one_vehicle(
    world: World,
    *,
    airframe: str = AIRFRAME,
    seed: int = 0,
    disturbances: VehicleFaults | None = None,
    px4: str | None = None,
    log_dir: Path | None = None,
) -> Iterator[Lockstep | Px4Lockstep]:
    """Yield the lockstep simulation of the first drone in the record of `world`.

    `px4`: the command that starts a PX4; None: the drone has the project's autopilot. `log_dir`: existing folder for
    PX4's output; None: the output is not kept.
    Raises UsageError for an airframe or command that cannot fly, InfrastructureError if PX4 ends.
    """
    config = SimulatorConfig(
        episode=world.record.id, airframe=airframe, seed=seed, speed=None, count=1,
        disturbances=disturbances, from_boot=True, px4=px4, log_dir=str(log_dir) if log_dir else None,
    )  # fmt: skip
    if px4 is None:
        yield Lockstep(build(SimulatedVehicle, world, config))
        return
    with closing(Px4Simulator(config, notify=lambda line: None, world=world)) as simulator:
        yield Px4Lockstep(simulator)


SPARE_S = 1.0  # s; link faults last this much longer than the flight's time limit, as the agent may still wait then


class LockstepStage(Stage):
    """A stage (everything around the agent) with the same parts as in real time, without sockets between them."""

    speed = None
    camera: WorldCamera

    def __init__(self, flight: Flight, simulated: Simulated, folder: Path, world: World) -> None:
        """`folder`: the episode folder, for the logs. Raises UsageError, InfrastructureError."""
        spec, camera = flight.spec, flight.camera_model
        self.camera_model = camera
        self._px4: Px4Simulator | None = None
        clock: Lockstep | Px4Lockstep
        ours: tuple[SimulatedVehicle, ...] = ()  # the vehicles with the project's autopilot
        config = simulator_config(spec, simulated, folder)
        if simulated.autopilot == "px4":
            self._px4 = Px4Simulator(config, world=world)
            clock = Px4Lockstep(self._px4)
        else:
            simulation = build(SimulatedVehicle, world, config)
            clock, ours = Lockstep(simulation), simulation.vehicles
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
        world.warm_up()
        drones = range(len(self._simulation.vehicles))
        self._disturbed = disturbed = DisturbedLinks(flight)
        wires = [clock.wire(index, disturbed.seed(index)) for index in drones] if disturbed.wired else []
        transports: list[Transport] = [*wires] or [clock.transport(index) for index in drones]
        self.links = disturbed.open(transports, wires, px4=self._px4 is not None)
        if self._px4:
            for drone, link in enumerate(self.links):
                link.listeners.append(partial(self._keep, drone))
        self.executor = InlineExecutor()

    def _log(self, port: VehiclePort, drone: int) -> None:
        self._recorder.telemetry(port.take(), drone)

    def _keep(self, drone: int, message: dialect.MAVLink_message) -> None:
        self._recorder.telemetry(bytes(message.get_msgbuf()), drone)

    def tap(self, feed: Callable[[bytes], None]) -> Callable[[], None]:
        """Feed the truth bus to a function after every tick, so the returned function does nothing."""
        self._clock.follow(feed)
        return lambda: None

    def begin(self, t0_us: int, cap_s: float) -> None:
        self._simulation.begin(t0_us)
        self._recorder.begin(t0_us, cap_s)
        self.camera.begin(t0_us)
        self._disturbed.begin(cap_s + SPARE_S)

    def mend(self) -> None:
        self._disturbed.mend()

    def end(self, reason: str, error: str | None = None) -> None:
        self._recorder.end(reason, error)

    def close(self) -> None:
        self._recorder.close()
        self.camera.close()
        if self._px4:
            for link in self.links:
                link.close()
            self._px4.close()
