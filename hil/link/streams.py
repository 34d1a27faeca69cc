"""Requests the telemetry messages of a flight, counts their arrivals, and adapts the requests to slow links.

A request may be lost on a bad link, forgotten after a restart, or not fulfilled: on a telemetry radio, PX4 reduces the
rates until they fit MAV_x_RATE. So arriving messages are counted.
"""

from collections import Counter
from dataclasses import dataclass

from foundation.mavlink import dialect
from foundation.protocol import SETPOINT_HZ

TICK_US = 1_000_000 // SETPOINT_HZ  # µs of vehicle time between two setpoints
WATCHED = {  # message id -> µs between two messages
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: TICK_US,
    dialect.MAVLINK_MSG_ID_ATTITUDE: TICK_US,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 200_000,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 500_000,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1_000_000,
    dialect.MAVLINK_MSG_ID_CURRENT_MODE: 100_000,
}
OFFERED = {dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: 100_000}  # requested like WATCHED, but flights do not need them
FAST = (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE)
ONCE = (  # requested as single messages until they arrive
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    dialect.MAVLINK_MSG_ID_HOME_POSITION,
)
CHECK_US = 3_000_000  # µs of vehicle time over which arrivals are counted
SHORT = 0.6  # share of the requested rate; below it, the link or the autopilot is too slow
DOUBLINGS = 2  # at most this many doublings of the intervals of FAST, down to 5 Hz: Offboard needs more than 2 Hz
SMALL = 0.05  # share of all bytes; a stream that we do not read is stopped only if it is larger
# messages that are not requested, but are never stopped
KEEP = frozenset({dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_STATUSTEXT})


@dataclass(frozen=True, slots=True)
class Interval:
    """A request: `interval_us` µs between two messages of `message_id`; −1 stops these messages."""

    message_id: int
    interval_us: int


class Streams:
    """Counts arriving messages and returns the next requests."""

    def __init__(self) -> None:
        self.wanted = dict(WATCHED)
        self.silenced: set[int] = set()
        self.slowed = 0  # number of doublings so far of the intervals of FAST
        self._missing = set(ONCE)
        self._arrived: set[int] = set()  # messages that have arrived at any time
        self._seen: Counter[int] = Counter()
        self._bytes: Counter[int] = Counter()
        self._lost: set[int] = set()  # messages that did not arrive before the last check
        self._since_us: int | None = None

    def saw(self, message_id: int, size: int) -> None:
        """Count a message of the autopilot and its length in bytes."""
        self._seen[message_id] += 1
        self._bytes[message_id] += size
        self._missing.discard(message_id)
        self._arrived.add(message_id)

    def all(self) -> list[Interval]:
        """Return all intervals to request."""
        wanted = [Interval(*item) for item in (self.wanted | OFFERED).items()]
        return wanted + [Interval(i, -1) for i in sorted(self.silenced)]

    def once(self) -> list[int]:
        """Return the ids of the single messages (ONCE) that have not arrived yet."""
        return [message_id for message_id in ONCE if message_id in self._missing]

    def quicken(self, interval_us: int) -> list[Interval]:
        """Set the interval of place and attitude to `interval_us`; return the requests for it."""
        self._seen.clear()
        self._bytes.clear()
        self._since_us = None  # restarts the counts
        for i in FAST:
            self.wanted[i] = interval_us
        return [Interval(i, interval_us) for i in FAST]

    def check(self, time_us: int) -> list[Interval]:
        """Return the requests to repeat, at most every three seconds of vehicle time.

        Missing messages are requested again. If they are missing at the next check too, or FAST is too slow, the link
        is full. Then streams that we do not read are stopped; if there are none, FAST is slowed down. FAST is not
        slowed for a message that never came, because the autopilot may not have it: PX4 1.14 has no CURRENT_MODE.
        """
        if self._since_us is None or time_us < self._since_us:
            self._since_us = time_us
            return []
        span_us = time_us - self._since_us
        if span_us < CHECK_US:
            return []
        rates = {i: self._seen[i] * interval_us / span_us for i, interval_us in self.wanted.items()}
        lost = {i for i in rates if span_us >= 2.5 * self.wanted[i] and not self._seen[i]}
        requests = [Interval(i, self.wanted[i]) for i in sorted(lost)]
        unknown = lost & self._lost - self._arrived
        gone = lost - unknown
        full = min(rates[i] for i in FAST) < SHORT if not gone else bool(gone & self._lost)
        if full or unknown:
            requests += self._relieve(slow=full) or (
                [] if gone or not full else [Interval(i, self.wanted[i]) for i in FAST]
            )
        self._lost = lost
        self._seen.clear()
        self._bytes.clear()
        self._since_us = time_us
        return requests

    def _relieve(self, *, slow: bool) -> list[Interval]:
        total = self._bytes.total()
        foreign = [
            i for i, n in self._bytes.items()
            if i not in self.wanted and i not in KEEP and i not in ONCE and n > SMALL * total
        ]  # fmt: skip
        if foreign:
            self.silenced.update(foreign)
            return [Interval(i, -1) for i in sorted(foreign)]
        if not slow or self.slowed >= DOUBLINGS:
            return []
        self.slowed += 1
        for i in FAST:
            self.wanted[i] *= 2
        return [Interval(i, self.wanted[i]) for i in FAST]
