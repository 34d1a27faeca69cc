"""The message intervals that a flight asks for: requested, checked by what really comes, fitted to the wire.

A request may be lost on a bad wire, forgotten by an autopilot that restarts, or refused by one that has no room: PX4
divides the rates of a telemetry radio by whatever it takes to fit MAV_x_RATE. So what arrives is counted.
"""

from collections import Counter
from dataclasses import dataclass

from foundation.mavlink import dialect
from foundation.protocol import SETPOINT_HZ

TICK_US = 1_000_000 // SETPOINT_HZ  # µs of vehicle time
WATCHED = {  # message id -> µs between two
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: TICK_US,
    dialect.MAVLINK_MSG_ID_ATTITUDE: TICK_US,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 200_000,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 500_000,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1_000_000,
    dialect.MAVLINK_MSG_ID_CURRENT_MODE: 100_000,
}
OFFERED = {dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: 100_000}  # taken where there is one, and not missed where not
FAST = (dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE)
ONCE = (  # asked for as single messages until they have come
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    dialect.MAVLINK_MSG_ID_HOME_POSITION,
)
CHECK_US = 3_000_000  # µs of vehicle time over which arrivals are counted
SHORT = 0.6  # of what was asked for: below it the wire or the autopilot does not keep up
DOUBLINGS = 2  # of the fast messages' interval, down to 5 Hz: PX4's offboard wants more than 2 Hz of setpoints
SMALL = 0.05  # share of the bytes under which a foreign stream is not worth silencing
KEEP = frozenset({dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_STATUSTEXT})


@dataclass(frozen=True, slots=True)
class Interval:
    """A request: `interval_us` µs between two messages of `message_id`; −1 silences it."""

    message_id: int
    interval_us: int


class Streams:
    """Counts what arrives and says what to ask for next."""

    def __init__(self) -> None:
        self.wanted = dict(WATCHED)
        self.silenced: set[int] = set()
        self.slowed = 0  # how often the fast messages' interval has been stretched
        self._missing = set(ONCE)
        self._seen: Counter[int] = Counter()
        self._bytes: Counter[int] = Counter()
        self._lost: set[int] = set()  # what did not come at all before the last check
        self._since_us: int | None = None

    def saw(self, message_id: int, size: int) -> None:
        """Take note of a message of the autopilot and of its length in bytes."""
        self._seen[message_id] += 1
        self._bytes[message_id] += size
        self._missing.discard(message_id)

    def all(self) -> list[Interval]:
        """Return every interval that is wanted."""
        wanted = [Interval(*item) for item in (self.wanted | OFFERED).items()]
        return wanted + [Interval(i, -1) for i in sorted(self.silenced)]

    def once(self) -> list[int]:
        """Return the single messages that have not come yet."""
        return [message_id for message_id in ONCE if message_id in self._missing]

    def quicken(self, interval_us: int) -> list[Interval]:
        """Have place and attitude come every `interval_us`; return what has to be asked for."""
        self._seen.clear()
        self._bytes.clear()
        self._since_us = None  # counted anew
        for i in FAST:
            self.wanted[i] = interval_us
        return [Interval(i, interval_us) for i in FAST]

    def check(self, time_us: int) -> list[Interval]:
        """Return what has to be asked for again, at most every three seconds of vehicle time.

        What does not come at all is asked for anew. What then still does not come, or comes too slowly, means that the
        wire is full: then streams that nobody here reads are silenced, and after that the fast ones slowed down.
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
        full = min(rates[i] for i in FAST) < SHORT if not lost else bool(lost & self._lost)
        if full:
            requests += self._relieve() or ([] if lost else [Interval(i, self.wanted[i]) for i in FAST])
        self._lost = lost
        self._seen.clear()
        self._bytes.clear()
        self._since_us = time_us
        return requests

    def _relieve(self) -> list[Interval]:
        total = self._bytes.total()
        foreign = [
            i for i, n in self._bytes.items()
            if i not in self.wanted and i not in KEEP and i not in ONCE and n > SMALL * total
        ]  # fmt: skip
        if foreign:
            self.silenced.update(foreign)
            return [Interval(i, -1) for i in sorted(foreign)]
        if self.slowed >= DOUBLINGS:
            return []
        self.slowed += 1
        for i in FAST:
            self.wanted[i] *= 2
        return [Interval(i, self.wanted[i]) for i in FAST]
