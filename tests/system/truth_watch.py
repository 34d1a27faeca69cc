"""Records the true motion of a simulated vehicle from its truth bus during a test."""

import math
from dataclasses import dataclass

from dronecats.flight.sitl.truth_listener import Listener
from foundation.errors import LinkError
from foundation.mavlink import Parser, dialect


@dataclass(frozen=True, slots=True)
class Motion:
    """One sample of the truth."""

    time_s: float  # vehicle clock
    speed: float  # m/s
    height: float  # m above mean sea level
    north: float  # m from the equator
    east: float  # m, along the parallel at this latitude


class TruthWatch:
    """A subscription to the truth bus, with all samples since its start."""

    def __init__(self, port):
        self.samples = []
        self._parser = Parser()
        self._listener = Listener(f"udpout://127.0.0.1:{port}", self._feed)

    def until(self, reached, seconds):
        """Read until `reached(newest sample)` is true. Raises LinkError after `seconds` of vehicle time."""
        self.newest()
        end_s = self.samples[-1].time_s + seconds
        while not reached(self.samples[-1]):
            if self.samples[-1].time_s > end_s:
                raise LinkError(f"the truth did not become so within {seconds:g} s: {self.samples[-1]}")
            self._read()
        return self.samples[-1]

    def newest(self):
        """Read all samples that have arrived, and return the newest one."""
        while self._listener.read(0.0) or not self.samples:
            if not self.samples:
                self._read()
        return self.samples[-1]

    def close(self):
        self._listener.close()

    def _read(self):
        for _ in range(40):
            if self._listener.read(0.5):
                return
        raise LinkError("the truth bus is silent")

    def _feed(self, data):
        for message in self._parser.feed(data):
            if message.get_msgId() == dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
                degree_m = 6_371_000.0 * math.pi / 180.0
                self.samples.append(
                    Motion(
                        message.time_usec * 1e-6,
                        math.hypot(message.vx, message.vy, message.vz) * 1e-2,
                        message.alt * 1e-3,
                        message.lat * 1e-7 * degree_m,
                        message.lon * 1e-7 * degree_m * math.cos(math.radians(message.lat * 1e-7)),
                    )
                )
