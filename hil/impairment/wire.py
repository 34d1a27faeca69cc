"""A bad wire between two MAVLink ends, in wall time between sockets or in vehicle time within one process."""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from foundation.errors import LinkError
from hil.impairment.channel import Channel, Counts, Impairment
from hil.link.transport import Transport

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


LOOK_S = 0.001  # s of waiting at one end before it is the other's turn: what comes is carried on within two


class ImpairedWire:
    """Runs between an agent and an autopilot from `start` to `close`, on a thread of its own."""

    def __init__(
        self,
        agent: Transport,
        autopilot: Transport,
        up: Impairment,
        down: Impairment,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,  # s; a wire is impaired in wall time, as a real one is, or faster
    ) -> None:
        self._agent, self._autopilot = agent, autopilot
        self._clock, self._zero_s = clock, clock()
        self._up, self._down = OneWay(up, seed, "up"), OneWay(down, seed, "down")
        self.fault: LinkError | None = None  # what ended the wire, None while it works
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="impaired-wire", daemon=True)

    @property
    def up(self) -> Channel:
        """The way to the autopilot."""
        return self._up.channel

    @property
    def down(self) -> Channel:
        """The way from the autopilot."""
        return self._down.channel

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """From now on and for so long (s of `clock`) be impaired like this, and after that perfect."""
        self._up.impair(up, seconds)
        self._down.impair(down, seconds)

    def start(self) -> "ImpairedWire":
        """Carry from now on, which is second 0 of the cuts; return self."""
        self._zero_s = self._clock()
        self._thread.start()
        return self

    @property
    def time_s(self) -> float:
        """Seconds since `start`."""
        return self._clock() - self._zero_s

    def pull(self, from_s: float, seconds: float) -> None:
        """Pull the cable, both ways, at a second of the wire's time that has yet to come, and plug it in again."""
        for channel in (self.up, self.down):
            wire = channel.impairment
            channel.impairment = replace(wire, cuts=(*wire.cuts, (from_s, from_s + seconds)))

    def check(self) -> None:
        """Raise the LinkError that ended the wire, if one did."""
        if self.fault is not None:
            raise self.fault

    def close(self) -> None:
        """End both directions and close both ends."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self._agent.close()
        self._autopilot.close()

    def __enter__(self) -> "ImpairedWire":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _carry(self) -> None:
        ways = ((self._agent, self._autopilot, self._up), (self._autopilot, self._agent, self._down))
        try:
            while not self._ending.is_set():
                for source, sink, way in ways:
                    data = source.receive(LOOK_S)
                    for unit in way.carry(self.time_s, data):
                        sink.send(unit)
        except LinkError as fault:
            self.fault = fault


class SteppedWire(Transport):
    """The agent's end of a wire that is perfect until it is impaired. Whoever reads from it when it is dry `pump`s.

    It carries at ticks: so a delay is lengthened to whole ones.
    """

    def __init__(
        self,
        url: str,
        take: Callable[[], bytes],
        give: Callable[[bytes], None],
        pump: Callable[[], None],
        now_s: Callable[[], float],
        seed: int,
        close: Callable[[], None] = lambda: None,
    ) -> None:
        """`take` returns what the vehicle has said, `give` lets it hear; `now_s` reads its clock, which `pump` moves.

        `pump` calls `step` once a tick.
        """
        self.url = url
        self._take, self._give, self._pump, self._now_s = take, give, pump, now_s
        self._up, self._down = OneWay(PERFECT, seed, "up"), OneWay(PERFECT, seed, "down")
        self._heard = bytearray()
        self._close = close

    def time_s(self) -> float:
        return self._now_s()

    def close(self) -> None:
        self._close()

    @property
    def counts(self) -> tuple[Counts, Counts]:
        """What has become of the frames, to the vehicle and from it, since the wire was last impaired or mended."""
        return self._up.channel.counts, self._down.channel.counts

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """From now on and for so long be impaired: `up` to the vehicle, `down` from it."""
        self._up.impair(up, seconds)
        self._down.impair(down, seconds)

    def step(self, said: bytes = b"") -> None:
        """Carry, once a tick, what has been said meanwhile; `said` by the vehicle has been taken already."""
        self.send(b"")
        self._hear(said)

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived; b'' when nothing did within `timeout_s` of the vehicle's time."""
        due_s = self._now_s() + timeout_s
        self._hear()
        while not self._heard and self._now_s() < due_s:
            self._pump()
        data = bytes(self._heard)
        self._heard.clear()
        return data

    def send(self, data: bytes) -> None:
        for unit in self._up.carry(self._now_s(), data):
            self._give(unit)

    def _hear(self, said: bytes = b"") -> None:
        for unit in self._down.carry(self._now_s(), said + self._take()):
            self._heard += unit
