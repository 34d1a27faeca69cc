"""The UDP ports of a simulation: one onboard, one ground station and one log port a vehicle, and the truth bus."""

from dronecats.sitl.simulation import SimulatedVehicle, Simulation, V
from dronecats.sitl.sockets import UdpPort

LOOPBACK = "127.0.0.1"
AGENT_PORT, GCS_PORT, TRUTH_PORT = 14540, 14550, 19410  # + instance, where clients listen
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
            ports = [vehicle.open_port(profile) for profile in ("onboard", "gcs", "minimal")]
            agent, gcs, log = ((port.take, port.receive) for port in ports)
            if instance is None:
                self.agent.append(UdpPort((LOOPBACK, 0), None, *agent))
                self.gcs.append(UdpPort((LOOPBACK, 0), (LOOPBACK, GCS_PORT), *gcs))
            else:
                self.agent.append(UdpPort((LOOPBACK, AGENT_LOCAL + n), (LOOPBACK, AGENT_PORT + n), *agent))
                self.gcs.append(UdpPort((LOOPBACK, GCS_LOCAL + n), (LOOPBACK, GCS_PORT), *gcs))
            self.log.append(UdpPort((LOOPBACK, 0), None, *log))

    def all(self) -> list[UdpPort]:
        return [self.truth, *self.agent, *self.gcs, *self.log]
