"""A MAVLink port of a simulated vehicle that outlives its autopilot, as a cable does."""

from autopilot.autopilot import Autopilot


class VehiclePort:
    """Leads to the port that the vehicle's present autopilot has opened for it."""

    def __init__(self, autopilot: Autopilot, profile: str) -> None:
        """Open a port of `profile`. Raises UsageError for an unknown one."""
        self._profile = profile
        self._port = autopilot.open_port(profile)
        self._last_words = b""

    def take(self) -> bytes:
        """Return what the vehicle has sent since the last call."""
        said, self._last_words = self._last_words, b""
        return said + self._port.take()

    def receive(self, data: bytes) -> None:
        """Let the vehicle hear this."""
        self._port.receive(data)

    def note_malformed(self) -> None:
        """Have the vehicle say that what came on this port was no MAVLink."""
        self._port.note_malformed()

    def move(self, autopilot: Autopilot) -> None:
        """Lead to an autopilot that has just booted; what the former one had still to say is kept."""
        self._last_words, signing = self.take(), self._port.signing
        self._port = autopilot.open_port(self._profile)
        self._port.signing = signing  # PX4 keeps the key on its memory card

    def sign(self, key: bytes, timestamp: int, now_us: int) -> None:
        """Sign with a key, and believe nobody else, from `timestamp` (10 µs since 2015) on, which is `now_us`."""
        self._port.signing.set_up(key, timestamp, now_us)
