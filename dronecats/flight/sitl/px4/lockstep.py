"""Vehicle time of a real PX4 that advances only while the agent's side waits for it.

Vehicle and PX4 are in step as ever. PX4's MAVLink threads are not: after each tick its telemetry has a moment of wall
time to arrive, so a flight is as fast as the machine allows, but not the same byte for byte when it is flown again.
"""

import time

from dronecats.flight.sitl.lockstep import TurnOrder
from dronecats.flight.sitl.ports import AGENT_PORT
from dronecats.flight.sitl.px4.simulator import Px4Simulator
from dronecats.flight.sitl.px4.vehicle import Px4Vehicle
from hil.impairment.stepped import SteppedWire
from hil.link.transport import Transport, connect

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
            socket.url, lambda: socket.receive(0.0), socket.send, self.pump, lambda: self.time_s, seed, socket.close
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
        due_s = time.monotonic() + timeout_s  # whoever waits for a PX4 that has gone must get to know it
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
