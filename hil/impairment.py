"""Seeded faults of a link: loss, delay, reordering and damage of MAVLink frames.

`Channel` is a pure model of one direction: the same seed and the same times give the same result. It draws four random
numbers for every frame that enters, also without faults. So frame n always has the same random numbers. A higher loss
drops the same frames, and some more. A second stream of random numbers, drawn only for frames that are not dropped,
gives the damaged bytes.
"""

import heapq
import math
import random
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

from foundation.declaration import Declaration, check_bounds, declared, number
from foundation.errors import LinkError, UsageError
from foundation.wire import Frames
from hil.link.transport import BITS_PER_BYTE, MemoryTransport, Transport

LATE_S = 0.1  # s, delay of a reordered frame: two ticks of the agent, so that later frames overtake it
LOST, DOUBLED, REORDERED = (f"{{percent:g}} % of frames {event}" for event in ("lost", "doubled", "out of order"))


def _cut_words(cuts: tuple[tuple[float, float], ...]) -> str:
    return " and ".join(f"a cut from {start:g} to {end:g} s" for start, end in cuts)


@dataclass(frozen=True, slots=True)
class Impairment:
    """The faults of one direction of a link. By default there are none."""

    loss: float = number(0.0, "loss", "share of MAVLink frames that never arrive", high=1.0, words=LOST)
    delay_s: float = number(
        0.0,
        "delay",
        "time that every MAVLink frame takes",
        high=60.0,
        unit="s",
        words="a delay of {value:g} s",
        first=True,
    )
    jitter_s: float = number(
        0.0,
        "jitter",
        "largest random addition to the constant delay (frames keep their order)",
        high=60.0,
        unit="s",
        words="jitter of {value:g} s",
        first=True,
    )
    duplicate: float = number(0.0, "duplicate", "share of MAVLink frames that arrive twice", high=1.0, words=DOUBLED)
    reorder: float = number(
        0.0,
        "reorder",
        f"share of MAVLink frames that arrive {LATE_S:g} s late and out of order",
        high=1.0,
        words=REORDERED,
    )
    corrupt: float = number(
        0.0, "corrupt", "share of bytes that arrive changed", high=1.0, words="{percent:g} % of bytes wrong"
    )
    baud: int | None = number(  # None: no limit on the speed
        None,
        "baud",
        "speed of a serial line, 10 bits a byte",
        low=300,
        high=100_000_000,
        unit="bit/s",
        whole=True,
        words="{value} baud and a queue of {owner.queue_bytes} bytes",
    )
    queue_bytes: int = number(  # the lower bound is the longest MAVLink frame
        2048,
        "queue",
        "size of the queue before the serial line; a frame that does not fit is dropped",
        low=280,
        high=10**12,
        unit="bytes",
        whole=True,
    )
    # times without the cable: (from, to) in s since the start of the link
    cuts: tuple[tuple[float, float], ...] = declared((), Declaration(words=_cut_words))

    def __post_init__(self) -> None:
        """Raise UsageError for impossible faults."""
        check_bounds(self)
        for start, end in self.cuts:
            if not 0.0 <= start < end < math.inf:
                raise UsageError(f"a cut must go from 0 s or later to a later time, got {start:g} to {end:g}")


@dataclass(slots=True)
class Counts:
    """Number of units per outcome. A unit is a MAVLink frame, or the bytes between two frames."""

    taken: int = 0
    arrived: int = 0  # duplicates count twice
    lost: int = 0
    cut: int = 0  # units that entered or were under way while the cable was unplugged
    overflowed: int = 0  # units that found the queue full
    duplicated: int = 0
    reordered: int = 0
    corrupted: int = 0  # units with at least one changed byte
    bytes_arrived: int = 0

    def __str__(self) -> str:
        """The counts in one line."""
        values = ((f.name.replace("_", " "), getattr(self, f.name)) for f in fields(self))
        return ", ".join(f"{name} {value}" for name, value in values if value or name in ("taken", "arrived"))


class Channel:
    """One direction of a link: units enter and leave. Times are in s since the start of the link, and never fall."""

    def __init__(self, impairment: Impairment, seed: int, direction: str = "") -> None:
        self.impairment = impairment
        self.counts = Counts()
        self._fate = random.Random(f"{seed} {direction} fate")
        self._noise = random.Random(f"{seed} {direction} noise")
        self._under_way: list[tuple[float, int, bytes]] = []  # heap of (arrival in s, order of entry, unit)
        self._entered = 0
        self._line_free_s = 0.0  # when the serial line has sent all its units
        self._newest_s = 0.0  # latest arrival of a unit that keeps its order

    def put(self, t_s: float, unit: bytes) -> None:
        """Let a unit enter at `t_s`."""
        wire, counts = self.impairment, self.counts
        loss, jitter, twice, late = (self._fate.random() for _ in range(4))
        counts.taken += 1
        sent_s = self._send(t_s, len(unit))
        if sent_s is None:
            counts.overflowed += 1
            return
        arrival_s = max(sent_s + wire.delay_s + jitter * wire.jitter_s, self._newest_s)
        if any(t_s < end and arrival_s >= start for start, end in wire.cuts):
            counts.cut += 1
            return
        if loss < wire.loss:
            counts.lost += 1
            return
        if late < wire.reorder:
            counts.reordered += 1
            arrival_s += LATE_S
        else:
            self._newest_s = arrival_s
        unit = self._noisy(unit)
        copies = 2 if twice < wire.duplicate else 1
        counts.duplicated += copies - 1
        for _ in range(copies):
            heapq.heappush(self._under_way, (arrival_s, self._entered, unit))
            self._entered += 1

    def arrived(self, t_s: float) -> Iterator[bytes]:
        """Yield the units that have arrived by `t_s`, in the order of arrival."""
        while self._under_way and self._under_way[0][0] <= t_s:
            unit = heapq.heappop(self._under_way)[2]
            self.counts.arrived += 1
            self.counts.bytes_arrived += len(unit)
            yield unit

    @property
    def next_s(self) -> float | None:
        """The arrival of the next unit; None: none is under way."""
        return self._under_way[0][0] if self._under_way else None

    def _send(self, t_s: float, length: int) -> float | None:
        """Return the time (s) at which the line has sent a unit that enters at `t_s`; None: the queue has no room."""
        if self.impairment.baud is None:
            return t_s
        bytes_per_s = self.impairment.baud / BITS_PER_BYTE
        waiting_bytes = max(0.0, self._line_free_s - t_s) * bytes_per_s
        if waiting_bytes + length > self.impairment.queue_bytes + 1e-6:
            return None
        self._line_free_s = max(self._line_free_s, t_s) + length / bytes_per_s
        return self._line_free_s

    def _noisy(self, unit: bytes) -> bytes:
        if not self.impairment.corrupt:
            return unit
        noise = self._noise
        data = bytes(b ^ noise.randrange(1, 256) if noise.random() < self.impairment.corrupt else b for b in unit)
        self.counts.corrupted += data != unit
        return data


PERFECT = Impairment()
ROUNDED_S = 1e-6  # s of tolerance for arrivals; without it, rounding could delay a unit by a tick


class OneWay:
    """One direction of a link, whose faults can change while it runs. Times are seconds of any rising clock."""

    def __init__(self, impairment: Impairment, seed: int, direction: str) -> None:
        self.channel = Channel(impairment, seed, direction)
        self._seed, self._direction = seed, direction
        self._frames = Frames()
        self._zero_s, self._over_s = 0.0, math.inf
        self._coming: tuple[Impairment, float] | None = None  # faults, seconds; set by another thread

    @property
    def counts(self) -> Counts:
        """Counts of units since the last change of the faults."""
        return self.channel.counts

    def impair(self, impairment: Impairment, seconds: float) -> None:
        """Apply these faults for `seconds` from the next `carry` on, and no faults afterwards.

        Units under way at the start or the end are lost. The random numbers start again from the seed.
        """
        self._coming = (impairment, seconds)

    def carry(self, now_s: float, data: bytes) -> list[bytes]:
        """Take the bytes that enter at `now_s`; return the units that have arrived by then, in the order of arrival."""
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


LOOK_S = 0.001  # s to wait for bytes at each end in turn; so a due unit is at most two waits late


class ImpairedWire:
    """A wire with faults between an agent and an autopilot. It runs on its own thread from `start` to `close`."""

    def __init__(
        self,
        agent: Transport,
        autopilot: Transport,
        up: Impairment,
        down: Impairment,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,  # returns s of wall time, or of a faster clock
    ) -> None:
        self._agent, self._autopilot = agent, autopilot
        self._clock, self._zero_s = clock, clock()
        self.up, self.down = OneWay(up, seed, "up"), OneWay(down, seed, "down")  # to and from the autopilot
        self.fault: LinkError | None = None  # the error that ended the wire; None: it works
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="impaired-wire", daemon=True)

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """Apply these faults for `seconds` (of `clock`) from now on, and no faults afterwards."""
        self.up.impair(up, seconds)
        self.down.impair(down, seconds)

    def start(self) -> "ImpairedWire":
        """Start the thread and return self. `time_s`, the clock of the cuts, starts at 0."""
        self._zero_s = self._clock()
        self._thread.start()
        return self

    @property
    def time_s(self) -> float:
        """Seconds since `start`."""
        return self._clock() - self._zero_s

    def pull(self, from_s: float, seconds: float) -> None:
        """Unplug the cable (both directions) for `seconds`, from `time_s` = `from_s` on. `impair` undoes this."""
        for channel in (self.up.channel, self.down.channel):
            wire = channel.impairment
            channel.impairment = replace(wire, cuts=(*wire.cuts, (from_s, from_s + seconds)))

    def check(self) -> None:
        """Raise the LinkError that ended the wire, if any."""
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
        ways = ((self._agent, self._autopilot, self.up), (self._autopilot, self._agent, self.down))
        try:
            while not self._ending.is_set():
                for source, sink, way in ways:
                    data = source.receive(LOOK_S)
                    for unit in way.carry(self.time_s, data):
                        sink.send(unit)
        except LinkError as fault:
            self.fault = fault


class SteppedWire(MemoryTransport):
    """The agent's end of a wire in lockstep, without faults until `impair`. A read of an empty wire calls `pump`.

    Units are forwarded only at ticks of the vehicle's clock, so a delay is rounded up to whole ticks.
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
        """`take` returns bytes of the vehicle, and `give` sends bytes to the vehicle.

        `now_s` reads the vehicle's clock (s). `pump` advances this clock, and calls `step` once per tick.
        """
        super().__init__(url, take, give, pump, now_s)
        self._up, self._down = OneWay(PERFECT, seed, "up"), OneWay(PERFECT, seed, "down")
        self._received = bytearray()
        self._close = close

    def close(self) -> None:
        self._close()

    @property
    def counts(self) -> tuple[Counts, Counts]:
        """Counts of units to the vehicle and from the vehicle, since the last change of the faults."""
        return self._up.counts, self._down.counts

    def impair(self, up: Impairment, down: Impairment, seconds: float) -> None:
        """Apply these faults for `seconds` from now on: `up` to the vehicle, `down` from it."""
        self._up.impair(up, seconds)
        self._down.impair(down, seconds)

    def step(self, data: bytes = b"") -> None:
        """Forward the units that are due; call this at every tick. `data`: bytes already taken from the vehicle."""
        self.send(b"")
        self._receive_frames(data)

    def receive(self, timeout_s: float) -> bytes:
        """Return the arrived bytes; b'' if none arrives in `timeout_s` on the vehicle's clock."""
        due_s = self.time_s() + timeout_s
        self._receive_frames()
        while not self._received and self.time_s() < due_s:
            self._pump()
        data = bytes(self._received)
        self._received.clear()
        return data

    def send(self, data: bytes) -> None:
        for unit in self._up.carry(self.time_s(), data):
            self._give(unit)

    def _receive_frames(self, data: bytes = b"") -> None:
        for unit in self._down.carry(self.time_s(), data + self._take()):
            self._received += unit
