"""A subscription to the truth bus (messages with true poses) of another process, over UDP."""

from collections.abc import Callable

from foundation.mavlink import Packer, dialect
from hil.link.transport import connect

HELLO = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)
SYSTEM, COMPONENT = 246, 191  # MAVLink ids of the subscriber


class Listener:
    """Receives bytes of the truth bus at a URL and passes them to `feed`."""

    def __init__(self, url: str, feed: Callable[[bytes], None]) -> None:
        self._transport = connect(url)
        self._feed = feed
        self._packer = Packer(SYSTEM, COMPONENT)
        self._has_data = False
        self._transport.send(self._packer.pack(HELLO))

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
