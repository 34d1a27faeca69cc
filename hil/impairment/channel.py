"""What a bad wire does to what goes over it, as a pure model: same seed and same times in, same fate.

The unit is one MAVLink frame. Whatever is random about a unit is drawn when it enters, always the same number of draws,
so the fate of the n-th unit depends on the seed and on n alone: more loss loses the same ones and others besides.
"""

import heapq
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, fields

from foundation.errors import UsageError

LATE_S = 0.1  # s that a unit out of order comes late: two ticks of the agent, so others do overtake it
BITS_A_BYTE = 10  # 8N1: a start bit, eight, a stop bit


@dataclass(frozen=True, slots=True)
class Impairment:
    """One direction of a wire. The defaults are a perfect one."""

    loss: float = 0.0  # share of units that never arrive
    delay_s: float = 0.0  # s, of every unit
    jitter_s: float = 0.0  # s, up to so much on top of the delay; keeps the order
    duplicate: float = 0.0  # share of units that arrive twice
    reorder: float = 0.0  # share of units that come LATE_S late, overtaken by those behind
    corrupt: float = 0.0  # share of bytes that arrive as another byte
    baud: int | None = None  # bit/s of a serial line, ten bits a byte; None: no limit
    queue_bytes: int = 2048  # what waits for the line; a unit that does not fit any more is dropped
    cuts: tuple[tuple[float, float], ...] = ()  # s since the wire began, from … to: the cable is pulled

    def __post_init__(self) -> None:
        """Raise UsageError for what no wire can be."""
        for name in ("loss", "duplicate", "reorder", "corrupt"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UsageError(f"{name} is a share from 0 to 1, got {getattr(self, name):g}")
        for name in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) <= 60.0:
                raise UsageError(f"{name.removesuffix('_s')} is 0 to 60 seconds, got {getattr(self, name):g}")
        if self.baud is not None and not 300 <= self.baud <= 100_000_000:
            raise UsageError(f"baud is 300 to 100,000,000 bit/s, got {self.baud}")
        if self.queue_bytes < 280:
            raise UsageError(f"queue has to hold one MAVLink frame, 280 bytes, got {self.queue_bytes}")
        for start, end in self.cuts:
            if not 0.0 <= start < end < math.inf:
                raise UsageError(f"a cut lasts from 0 s or later to a later moment, got {start:g} to {end:g}")


@dataclass(slots=True)
class Counts:
    """What has become of the units."""

    taken: int = 0
    arrived: int = 0  # duplicates count twice
    lost: int = 0
    cut: int = 0  # entered, or were on their way, while the cable was pulled
    overflowed: int = 0  # found the queue full
    duplicated: int = 0
    reordered: int = 0
    corrupted: int = 0  # units with at least one changed byte
    bytes_arrived: int = 0

    def __str__(self) -> str:
        """All that happened, in one line."""
        told = ((f.name.replace("_", " "), getattr(self, f.name)) for f in fields(self))
        return ", ".join(f"{name} {value}" for name, value in told if value or name in ("taken", "arrived"))


class Channel:
    """One direction: units go in at a time and come out at a time. Times are seconds since the wire began, rising."""

    def __init__(self, impairment: Impairment, seed: int, direction: str = "") -> None:
        self.impairment = impairment
        self.counts = Counts()
        self._fate = random.Random(f"{seed} {direction} fate")
        self._noise = random.Random(f"{seed} {direction} noise")  # draws per byte: a stream of its own
        self._under_way: list[tuple[float, int, bytes]] = []  # heap of (arrival in s, order of entry, unit)
        self._entered = 0
        self._line_free_s = 0.0  # when the serial line has sent all that it holds
        self._newest_s = 0.0  # arrival of the newest unit that is in order

    def put(self, t_s: float, unit: bytes) -> None:
        """A unit enters."""
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
        """Yield the units that have arrived by `t_s`, in the order in which they did."""
        while self._under_way and self._under_way[0][0] <= t_s:
            unit = heapq.heappop(self._under_way)[2]
            self.counts.arrived += 1
            self.counts.bytes_arrived += len(unit)
            yield unit

    @property
    def next_s(self) -> float | None:
        """When the next unit arrives, None when none is under way."""
        return self._under_way[0][0] if self._under_way else None

    def _send(self, t_s: float, length: int) -> float | None:
        """Return when the serial line has sent a unit that enters now, None when the queue has no room for it."""
        if self.impairment.baud is None:
            return t_s
        bytes_per_s = self.impairment.baud / BITS_A_BYTE
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
