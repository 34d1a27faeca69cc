"""A bad wire between two MAVLink ends: whatever one says reaches the other through a `Channel` of its own."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from foundation.errors import LinkError
from hil.impairment.channel import Channel, Impairment
from hil.impairment.one_way import OneWay
from hil.link.transport import Transport

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
