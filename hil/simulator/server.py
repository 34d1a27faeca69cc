"""The simulator's end of PX4's simulator interface on TCP: PX4 is the client, and comes back after it has restarted."""

import contextlib
import select
import socket

from foundation.mavlink import Parser, dialect
from hil.link.transport import bind_error

PORT = 4560  # + instance
SEND_S = 5.0  # wall seconds after which a PX4 that reads nothing any more is given up


class SimulatorServer:
    """Listens for one PX4 at a time; a newer connection takes the place of the older."""

    def __init__(self, port: int, host: str = "127.0.0.1", instead: str = "choose another port") -> None:
        """Listen. Port 0 is one that the system chooses.

        Raises UsageError for a port that is in use, with the advice `instead`.
        """
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # PX4 may come back within a minute
        try:
            self._listener.bind((host, port))
            self._listener.listen(1)  # of two that have bound the same port, the second fails here
        except OSError as error:
            self._listener.close()
            raise bind_error(error, "TCP", host, port, instead) from None
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self._parser = Parser()
        self.connections = 0  # how many there have been

    @property
    def port(self) -> int:
        """The TCP port that is listened on."""
        return int(self._listener.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether a PX4 is there, as far as has been noticed."""
        return self._peer is not None

    def accept(self) -> bool:
        """Take a connection that waits; return whether there was one."""
        try:
            peer, _ = self._listener.accept()
        except BlockingIOError:
            return False
        self._drop()
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.settimeout(SEND_S)
        self._peer, self._parser = peer, Parser()
        self.connections += 1
        return True

    def send(self, data: bytes) -> None:
        """Send to the PX4 that is there; one that has gone is noticed, and is no error."""
        if self._peer is not None:
            try:
                self._peer.sendall(data)
            except OSError:
                self._drop()

    def receive(self, timeout_s: float) -> list[dialect.MAVLink_message]:
        """Return the messages that came within `timeout_s` wall seconds; none when PX4 is silent or has gone."""
        if self._peer is None or not select.select([self._peer], [], [], timeout_s)[0]:
            return []
        data = b""
        with contextlib.suppress(OSError):
            data = self._peer.recv(65536)
        if not data:
            self._drop()
        return self._parser.feed(data)

    def close(self) -> None:
        self._drop()
        self._listener.close()

    def _drop(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None
