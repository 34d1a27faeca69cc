"""One direction of a bad wire: bytes go in, whole MAVLink frames come out when they have arrived."""

import math

from hil.impairment.channel import Channel, Impairment

MAVLINK1, MAVLINK2, SIGNED, SIGNATURE_BYTES = 0xFE, 0xFD, 0x01, 13
PERFECT = Impairment()
ROUNDED_S = 1e-6  # s, or what is due at a tick of a clock might miss it by the rounding of its seconds


class Frames:
    """Cuts a stream of bytes where its MAVLink frames begin and end, whatever they hold: a wire reads no messages."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the whole frames, in order; bytes that belong to none form units of their own."""
        data = self._rest + data
        units, at = [], 0
        while at < len(data):
            length = _frame_length(data, at)
            if length is None or at + length > len(data):
                break
            units.append(data[at : at + length])
            at += length
        self._rest = data[at:]
        return units


def _frame_length(data: bytes, at: int) -> int | None:
    """Return the bytes of the unit that begins at `at`, None while its header is not all there."""
    magic = data[at]
    if magic not in (MAVLINK1, MAVLINK2):
        starts = [i for i in (data.find(MAVLINK1, at), data.find(MAVLINK2, at)) if i >= 0]
        return min(starts, default=len(data)) - at
    if len(data) < at + 3:
        return None
    if magic == MAVLINK1:
        return 8 + data[at + 1]
    return 12 + data[at + 1] + (SIGNATURE_BYTES if data[at + 2] & SIGNED else 0)


class OneWay:
    """Impaired as it is told to be, from the beginning or for a while. Times are seconds of any clock that rises."""

    def __init__(self, impairment: Impairment, seed: int, direction: str) -> None:
        self.channel = Channel(impairment, seed, direction)
        self._seed, self._direction = seed, direction
        self._frames = Frames()
        self._zero_s, self._over_s = 0.0, math.inf
        self._coming: tuple[Impairment, float] | None = None  # set by another thread: taken at the next carrying

    def impair(self, impairment: Impairment, seconds: float) -> None:
        """From the next carrying on and for so long be impaired like this, and after that perfect.

        What is on its way at either moment is lost. The first frame then has the seed's first fate.
        """
        self._coming = (impairment, seconds)

    def carry(self, now_s: float, data: bytes) -> list[bytes]:
        """Take what enters now; return the units that have arrived, in the order in which they did."""
        if self._coming is not None:
            (impairment, seconds), self._coming = self._coming, None
            self._begin(impairment, now_s, now_s + seconds)
        elif now_s >= self._over_s:
            self._begin(PERFECT, now_s, math.inf)
        for unit in self._frames.feed(data):
            self.channel.put(now_s - self._zero_s, unit)
        return list(self.channel.arrived(now_s - self._zero_s + ROUNDED_S))

    def _begin(self, impairment: Impairment, now_s: float, over_s: float) -> None:
        self.channel = Channel(impairment, self._seed, self._direction)
        self._zero_s, self._over_s = now_s, over_s
