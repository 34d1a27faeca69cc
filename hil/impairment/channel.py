"""What a bad wire does to what goes over it, as a pure model: same seed and same times in, same fate.

The unit is one MAVLink frame. Whatever is random about a unit is drawn when it enters, always the same number of draws,
so the fate of the n-th unit depends on the seed and on n alone: more loss loses the same ones and others besides.
"""

import heapq
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, fields

from foundation.declaration import Declaration, check_bounds, declared, number
from foundation.errors import UsageError

LATE_S = 0.1  # s that a unit out of order comes late: two ticks of the agent, so others do overtake it
BITS_A_BYTE = 10  # 8N1: a start bit, eight, a stop bit
LOST, DOUBLED, REORDERED = (f"{{percent:g}} % of frames {what}" for what in ("lost", "doubled", "out of order"))


def _cut_words(cuts: tuple[tuple[float, float], ...]) -> str:
    return " and ".join(f"a cut from {start:g} to {end:g} s" for start, end in cuts)


@dataclass(frozen=True, slots=True)
class Impairment:
    """One direction of a wire. The defaults are a perfect one. A unit is a frame."""

    loss: float = number(0.0, "loss", "share of frames that never arrive", high=1.0, words=LOST)
    delay_s: float = number(
        0.0, "delay", "time that every frame takes", high=60.0, unit="s", words="a delay of {value:g} s", first=True
    )
    jitter_s: float = number(
        0.0,
        "jitter",
        "up to so much on top of the delay; the order stays",
        high=60.0,
        unit="s",
        words="jitter of {value:g} s",
        first=True,
    )
    duplicate: float = number(0.0, "duplicate", "share of frames that arrive twice", high=1.0, words=DOUBLED)
    reorder: float = number(
        0.0, "reorder", f"share of frames that arrive {LATE_S:g} s late, after others", high=1.0, words=REORDERED
    )
    corrupt: float = number(
        0.0, "corrupt", "share of bytes that arrive as another byte", high=1.0, words="{percent:g} % of bytes wrong"
    )
    baud: int | None = number(  # None: no limit
        None,
        "baud",
        "speed of a serial line, 10 bits a byte",
        low=300,
        high=100_000_000,
        unit="bit/s",
        whole=True,
        words="{value} baud and a queue of {owner.queue_bytes} bytes",
    )
    queue_bytes: int = number(  # at least one MAVLink frame
        2048,
        "queue",
        "what waits for the line; a frame that does not fit is dropped",
        low=280,
        high=10**12,
        unit="bytes",
        whole=True,
    )
    # s since the wire began, from … to: the cable is pulled
    cuts: tuple[tuple[float, float], ...] = declared((), Declaration(words=_cut_words))

    def __post_init__(self) -> None:
        """Raise UsageError for what no wire can be."""
        check_bounds(self)
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
