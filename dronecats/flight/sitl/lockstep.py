"""Lockstep: the vehicle's time advances only while a client waits for it, so a run is deterministic and never idle.

Every message is still encoded to MAVLink bytes and decoded again; only the sockets are left out.
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
    """Advance the simulation one tick, then let the followers read what came of it."""

    def __init__(self, simulation: Simulation[V]) -> None:
        self.simulation = simulation
        self.followers: list[Callable[[], None]] = []

    def pump(self) -> None:
        """One tick of vehicle time."""
        self.simulation.advance()
        for follower in self.followers:
            follower()

    @abstractmethod
    def transport(self, vehicle: int) -> Transport:
        """Return the agent's end of the MAVLink of one vehicle's autopilot."""

    @abstractmethod
    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        """Return the agent's end of the same over a wire that can be impaired, by the fates of `seed`."""

    def now_s(self) -> float:
        """Return the vehicle time (s)."""
        return self.simulation.time_us / 1e6

    def follow(self, feed: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Let `feed` have the truth bus after every tick; return the function that speaks on it."""
        tap = self.simulation.bus.tap()

        def follow_on() -> None:
            data = tap.take()
            if data:
                feed(data)

        self.followers.append(follow_on)
        return tap.receive


class Lockstep(TurnOrder[SimulatedVehicle]):
    """The turn order of vehicles with our autopilot, which answers at once."""

    def transport(self, vehicle: int, profile: str = "minimal") -> Transport:
        """Return the agent's end of a MAVLink port of one vehicle's autopilot; `minimal` streams what is asked for."""
        port = self.simulation.vehicles[vehicle].open_port(profile)
        return MemoryTransport(f"lockstep://{vehicle}", port.take, port.receive, self.pump, self.now_s)

    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        port = self.simulation.vehicles[vehicle].open_port("minimal")
        wire = SteppedWire(f"lockstep://{vehicle}", port.take, port.receive, self.pump, self.now_s, seed)
        self.followers.append(wire.step)
        return wire


MOMENT_S = 0.002  # wall seconds; PX4's ATTITUDE comes on every tick, mostly within a third of a millisecond


class Px4Lockstep(TurnOrder[Px4Vehicle]):
    """The turn order of vehicles with PX4 in our autopilot's place."""

    def __init__(self, simulator: Px4Simulator) -> None:
        """Wait until every vehicle has a PX4 that answers. Raises InfrastructureError when one that we started ends."""
        super().__init__(simulator.simulation)
        self._simulator = simulator
        while not simulator.do("in step", {}):
            simulator.turn()

    def pump(self) -> None:
        """One tick of vehicle time, or a short wait for a PX4 that has not come yet."""
        self._simulator.turn()
        for follower in self.followers:
            follower()

    def transport(self, vehicle: int) -> "PumpedTransport":
        """Return PX4's offboard link of one vehicle. Raises UsageError when its port is taken."""
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
    """A socket that lets vehicle time pass when it runs dry."""

    def __init__(self, socket: Transport, clock: Px4Lockstep) -> None:
        self.url = socket.url
        self._socket, self._clock = socket, clock

    def receive(self, timeout_s: float) -> bytes:
        data = self._socket.receive(0.0)
        due_s = time.monotonic() + timeout_s  # a wait for a PX4 that has gone must end
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
    """Stand the record's first drone in its world, under our autopilot or the PX4 that the command `px4` starts.

    log_dir: an existing folder for what PX4 prints; None: it is not kept.
    Raises UsageError for an airframe or command that cannot fly, InfrastructureError where PX4 ends.
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
