"""The UDP ports of a simulation: one onboard, one ground station and one log port a vehicle, and the truth bus."""

import time

from dronecats.flight.sitl.simulation import SimulatedVehicle, Simulation, V
from dronecats.flight.sitl.sockets import UdpPort
from dronecats.flight.sitl.vehicle_port import VehiclePort

LOOPBACK = "127.0.0.1"
AGENT_PORT, GCS_PORT, TRUTH_PORT = 14540, 14550, 19410  # + instance, where clients listen
CAMERA_PORT = 8080  # + instance, TCP, of the camera; the next free one where it is taken
AGENT_LOCAL, GCS_LOCAL, TRUTH_LOCAL = 14580, 18570, 19450  # + instance, where the simulator listens


def truth_port(simulation: Simulation[V], instance: int | None) -> UdpPort:
    """Return the truth bus on UDP; `instance` None: on an ephemeral port, and to whoever speaks to it only."""
    tap = simulation.bus.tap()
    if instance is None:
        return UdpPort((LOOPBACK, 0), None, tap.take, tap.receive, shared=True)
    local, remote = (LOOPBACK, TRUTH_LOCAL + instance), (LOOPBACK, TRUTH_PORT + instance)
    return UdpPort(local, remote, tap.take, tap.receive, shared=True)


class Ports:
    """Every UDP port of a simulation. `instance` None: ephemeral ones, but for the ground station's."""

    def __init__(self, simulation: Simulation[SimulatedVehicle], instance: int | None) -> None:
        self.agent, self.gcs, self.log = [], [], []
        self.truth = truth_port(simulation, instance)
        for vehicle in simulation.vehicles:
            n = (instance or 0) + vehicle.index
            onboard, gcs, log = (vehicle.open_port(profile) for profile in ("onboard", "gcs", "minimal"))
            if instance is None:
                self.agent.append(_udp(onboard, 0, None))
                self.gcs.append(_udp(gcs, 0, GCS_PORT))
            else:
                self.agent.append(_udp(onboard, AGENT_LOCAL + n, AGENT_PORT + n))
                self.gcs.append(_udp(gcs, GCS_LOCAL + n, GCS_PORT))
            self.log.append(_udp(log, 0, None))

    def exchange(self, work_s: float) -> None:
        """Exchange with all clients. What they send is worked on for about `work_s` of wall time."""
        until_s = time.monotonic() + work_s
        for port in self._all():
            port.exchange(until_s)

    def close(self) -> None:
        for port in self._all():
            port.close()

    def _all(self) -> list[UdpPort]:
        return [self.truth, *self.agent, *self.gcs, *self.log]


def _udp(port: VehiclePort, local: int, remote: int | None) -> UdpPort:
    there = (LOOPBACK, remote) if remote is not None else None
    return UdpPort((LOOPBACK, local), there, port.take, port.receive, malformed=port.note_malformed)
