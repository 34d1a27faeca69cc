"""The truth bus: the simulator's truth goes to every listener, and what one listener says goes to all the others.

So the camera's "frame taken" reaches the logger over the same MAVLink wire as the poses.
"""


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
        """Say something to everybody else."""
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
    def heard(self) -> bool:
        """Whether anybody listens."""
        return bool(self._taps)

    def publish(self, data: bytes, but: Tap | None = None) -> None:
        if not data:
            return
        for tap in self._taps:
            if tap is not but:
                tap.put(data)
