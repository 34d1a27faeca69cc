"""Lockstep: the vehicle's time advances only while somebody waits for it, so a run is deterministic and never idle.

Every message is still encoded to MAVLink bytes and decoded again; only the sockets are left out.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic

from dronecats.flight.sitl.simulation import SimulatedVehicle, Simulation, V
from hil.impairment import SteppedWire
from hil.link.transport import MemoryTransport, Transport


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

    @property
    def time_s(self) -> float:
        """s of vehicle time."""
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
        return MemoryTransport(f"lockstep://{vehicle}", port.take, port.receive, self.pump, lambda: self.time_s)

    def wire(self, vehicle: int, seed: int) -> SteppedWire:
        port = self.simulation.vehicles[vehicle].open_port("minimal")
        wire = SteppedWire(f"lockstep://{vehicle}", port.take, port.receive, self.pump, lambda: self.time_s, seed)
        self.followers.append(wire.step)
        return wire
