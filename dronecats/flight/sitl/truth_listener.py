"""A subscription to the truth bus (messages with true poses), or to telemetry, of another process over UDP."""

from collections.abc import Callable

from foundation.mavlink import Packer, dialect
from hil.link.transport import UdpTransport, connect

HELLO = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)
IDS = 246, 191  # MAVLink ids of the subscriber


class Listener:
    """A subscription to the truth bus or telemetry of another process. It passes the bytes from a URL to `feed`."""

    def __init__(self, url: str, feed: Callable[[bytes], None]) -> None:
        self._transport = connect(url)
        self._feed = feed
        self._packer = Packer(*IDS)
        self._has_data = False
        self._transport.send(self._packer.pack(HELLO))

    @property
    def port(self) -> int:
        """The local UDP port, to which others can send if the URL is `udpin`."""
        assert isinstance(self._transport, UdpTransport)
        return self._transport.port

    def read(self, timeout_s: float) -> bool:
        """Pass on the bytes that arrive within `timeout_s`; return whether any arrived."""
        data = self._transport.receive(timeout_s)
        if data:
            self._has_data = True
            self._feed(data)
        elif not self._has_data:
            self._transport.send(self._packer.pack(HELLO))  # again: the simulator may not have listened before
        return bool(data)

    def drain(self) -> None:
        """Pass on all bytes that have arrived."""
        while self.read(0.0):
            pass

    def send(self, data: bytes) -> None:
        self._transport.send(data)

    def close(self) -> None:
        self._transport.close()
