"""Lockstep: the vehicle's time advances only while somebody waits for it, so a run is deterministic and never idle.

Every message is still encoded to MAVLink bytes and decoded again; only the sockets are left out.
"""

from collections.abc import Callable

from dronecats.sitl.simulation import SimulatedVehicle, Simulation
from hil.link.transport import MemoryTransport, Transport


class Lockstep:
    """Owns the turn order: advance the simulation one tick, then let the followers read what came of it."""

    def __init__(self, simulation: Simulation[SimulatedVehicle]) -> None:
        self.simulation = simulation
        self.followers: list[Callable[[], None]] = []

    def pump(self) -> None:
        """One tick of vehicle time."""
        self.simulation.advance()
        for follower in self.followers:
            follower()

    def transport(self, vehicle: int, profile: str = "minimal") -> Transport:
        """Return the agent's end of a MAVLink port of one vehicle's autopilot; `minimal` streams what is asked for."""
        port = self.simulation.vehicles[vehicle].open_port(profile)
        return MemoryTransport(f"lockstep://{vehicle}", port.take, port.receive, self.pump)

    def follow(self, feed: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Let `feed` have the truth bus after every tick; return the function that speaks on it."""
        tap = self.simulation.bus.tap()

        def follow_on() -> None:
            data = tap.take()
            if data:
                feed(data)

        self.followers.append(follow_on)
        return tap.receive
