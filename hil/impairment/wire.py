"""A bad wire between two MAVLink ends: whatever one says reaches the other through a `Channel` of its own."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from foundation.errors import LinkError
from hil.impairment.channel import Channel, Impairment
from hil.link.transport import Transport

LOOK_S = 0.001  # s of waiting at one end before it is the other's turn: what comes is carried on within two
MAVLINK1, MAVLINK2, SIGNED, SIGNATURE_BYTES = 0xFE, 0xFD, 0x01, 13


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


class ImpairedWire:
    """Runs between an agent and an autopilot from `start` to `close`, on a thread of its own."""

    def __init__(
        self,
        agent: Transport,
        autopilot: Transport,
        up: Impairment,
        down: Impairment,
        seed: int = 0,
        clock: Callable[[], float] = time.monotonic,  # s; a wire is impaired in wall time, as a real one is
    ) -> None:
        self._agent, self._autopilot = agent, autopilot
        self._clock, self._zero_s = clock, clock()
        self.up, self.down = Channel(up, seed, "up"), Channel(down, seed, "down")
        self.fault: LinkError | None = None  # what ended the wire, None while it works
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="impaired-wire", daemon=True)

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
        ways = (
            (self._agent, self._autopilot, self.up, Frames()),
            (self._autopilot, self._agent, self.down, Frames()),
        )
        try:
            while not self._ending.is_set():
                for source, sink, channel, frames in ways:
                    units = frames.feed(source.receive(LOOK_S))
                    now_s = self.time_s
                    for unit in units:
                        channel.put(now_s, unit)
                    for unit in channel.arrived(now_s):
                        sink.send(unit)
        except LinkError as fault:
            self.fault = fault
