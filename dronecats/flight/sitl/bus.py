"""The truth bus, within one process and over UDP."""

from collections.abc import Callable

from foundation.mavlink import Packer, dialect
from hil.link.transport import connect


class Tap:
    """One listener's end of the bus."""

    def __init__(self, bus: "TruthBus") -> None:
        self._bus = bus
        self._queue = bytearray()

    def take(self) -> bytes:
        """Return everything that came since the last take."""
        if not self._queue:
            return b""
        data = bytes(self._queue)
        self._queue.clear()
        return data

    def receive(self, data: bytes) -> None:
        """Send bytes to all other subscribers."""
        self._bus.publish(data, but=self)

    def put(self, data: bytes) -> None:
        self._queue += data


class TruthBus:
    """Bytes in from one, out to all others."""

    def __init__(self) -> None:
        self._taps: list[Tap] = []

    def tap(self) -> Tap:
        tap = Tap(self)
        self._taps.append(tap)
        return tap

    @property
    def has_listeners(self) -> bool:
        """Whether it has a subscriber."""
        return bool(self._taps)

    def publish(self, data: bytes, but: Tap | None = None) -> None:
        if not data:
            return
        for tap in self._taps:
            if tap is not but:
                tap.put(data)


HELLO = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)
SYSTEM, COMPONENT = 246, 191


class Listener:
    """Reads one URL."""

    def __init__(self, url: str, feed: Callable[[bytes], None]) -> None:
        self._transport = connect(url)
        self._feed = feed
        self._packer = Packer(SYSTEM, COMPONENT)
        self._has_data = False
        self._transport.send(self._packer.pack(HELLO))

    def read(self, timeout_s: float) -> bool:
        """Hand on what has come within `timeout_s`; return whether anything has."""
        data = self._transport.receive(timeout_s)
        if data:
            self._has_data = True
            self._feed(data)
        elif not self._has_data:
            self._transport.send(self._packer.pack(HELLO))  # the simulator was not listening yet
        return bool(data)

    def drain(self) -> None:
        """Hand on all that has come."""
        while self.read(0.0):
            pass

    def send(self, data: bytes) -> None:
        self._transport.send(data)

    def close(self) -> None:
        self._transport.close()
