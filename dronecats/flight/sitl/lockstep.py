"""Lockstep: vehicle time advances only while a client waits for data.

With the project's autopilot a flight is deterministic, and MAVLink bytes are exchanged without sockets.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Generic

from dronecats.flight.sitl.config import AIRFRAME, SimulatorConfig
from dronecats.flight.sitl.px4 import Px4Simulator, Px4Vehicle
from dronecats.flight.sitl.simulation import SimulatedVehicle, Simulation, V, build
from dronecats.flight.sitl.sockets import AGENT_PORT
from dronecats.flight.spec.disturbances import VehicleFaults
from episodes.world.world import World
from hil.impairment import SteppedWire
from hil.link.transport import MemoryTransport, Transport, connect


class TurnOrder(ABC, Generic[V]):
    """Advances the simulation by one tick, then calls the followers, which read the new bytes."""

    def __init__(self, simulation: Simulation[V]) -> None:
        self.simulation = simulation
        self.followers: list[Callable[[], None]] = []

    def pump(self) -> None:
        """Advance by one tick of vehicle time."""
        self.simulation.advance()
        for follower in self.followers:
            follower()

    @abstractmethod
    def transport(self, vehicle: int) -> Transport:
        """Return the agent's end of the MAVLink connection to one vehicle's autopilot."""

    @abstractmethod
    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        """Return the agent's end of a connection that can be impaired; `seed`: of its random faults."""

    def now_s(self) -> float:
        """Return the vehicle time (s)."""
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
        """Return the offboard link of one vehicle's PX4. Raises UsageError if its port is in use."""
        return PumpedTransport(self._socket(vehicle), self)

    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        socket = self._socket(vehicle)
        wire = SteppedWire(
            socket.url, lambda: socket.receive(0.0), socket.send, self.pump, self.now_s, seed, socket.close
        )
        self.followers.append(lambda: wire.step(socket.receive(MOMENT_S)))
        return wire

    def _socket(self, vehicle: int) -> Transport:
        return connect(f"udpin://127.0.0.1:{AGENT_PORT + self._simulator.instance + vehicle}")


class PumpedTransport(Transport):
    """A socket that advances vehicle time while a read waits for data."""

    def __init__(self, socket: Transport, clock: Px4Lockstep) -> None:
        self.url = socket.url
        self._socket, self._clock = socket, clock

    def receive(self, timeout_s: float) -> bytes:
        data = self._socket.receive(0.0)
        due_s = time.monotonic() + timeout_s  # wall time, so that the wait ends if PX4 has gone
        while not data and time.monotonic() < due_s:
            self._clock.pump()
            data = self._socket.receive(MOMENT_S)
        self.peer = self._socket.peer
        return data

    def follow(self, peer: str) -> None:
        self._socket.follow(peer)

    def send(self, data: bytes) -> None:
        self._socket.send(data)

    def close(self) -> None:
        self._socket.close()


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
    """Yield the lockstep simulation of the record's first drone in its world.

    `px4`: the command that starts a PX4; None: the drone has the project's autopilot. `log_dir`: existing folder for
    PX4's output; None: it is not kept.
    Raises UsageError for an airframe or command that cannot fly, InfrastructureError if PX4 ends.
    """
    if px4 is None:
        yield Lockstep(build(world, airframe=airframe, seed=seed, count=1, disturbances=disturbances, from_boot=True))
        return
    config = SimulatorConfig(
        episode=world.record.id, airframe=airframe, seed=seed, speed=None, count=1,
        disturbances=disturbances, from_boot=True, px4=px4, log_dir=str(log_dir) if log_dir else None,
    )  # fmt: skip
    with closing(Px4Simulator(config, notify=lambda line: None, world=world)) as simulator:
        yield Px4Lockstep(simulator)
