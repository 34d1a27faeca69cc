"""Free ports, for programs that need a port number."""

import socket


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """Return a free port of the loopback interface: UDP by default. The system has just assigned and released it."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def free_instance() -> int:
    """Return the number of a PX4 instance whose ports are free."""
    from dronecats.flight.sitl.px4 import free_servers  # imports the flight core
    from hil.simulator import PORT

    [server] = free_servers(1)
    instance = server.port - PORT
    server.close()
    return instance
