"""Collects the messages of an autopilot during a preflight check, and defines the rows of its result."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from foundation.mavlink import dialect
from hil.link.autopilots import Firmware, firmware
from hil.link.link import Link
from hil.link.telemetry import StatusTexts


@dataclass(frozen=True, slots=True)
class Row:
    """One result of a check."""

    name: str
    passed: bool | None  # None: not measured, or only a person can judge it
    why: str
    fix: str = ""  # what to do; empty: nothing


@dataclass(frozen=True, slots=True)
class Change:
    """A proposed change of a parameter."""

    name: str
    old: float
    new: float
    reason: str


@dataclass(frozen=True, slots=True)
class RuleResult:
    """The result of a rule. The fields are those of a `Row`, and of the `Change` that would correct it."""

    passed: bool | None
    why: str
    fix: str = ""
    new: float | None = None  # None: no change is proposed
    reason: str = ""

    def named(self, name: str) -> Row:
        """Return the row of a rule with this name."""
        return Row(name, self.passed, self.why, self.fix)


def good(why: str) -> RuleResult:
    return RuleResult(True, why)


def bad(why: str, fix: str) -> RuleResult:
    return RuleResult(False, why, fix)


def unclear(why: str, fix: str = "") -> RuleResult:
    return RuleResult(None, why, fix)


@dataclass(frozen=True, slots=True)
class Finding:
    """A row, and the parameter change that would correct it."""

    row: Row
    change: Change | None = None


def summary(rows: Sequence[Row]) -> str:
    """Return the last line of the table: the numbers of rows that passed, failed and are open."""
    count = {mark: sum(row.passed is mark for row in rows) for mark in (True, False, None)}
    return f"{count[True]} passed, {count[False]} failed, {count[None]} for you to check"


Message: TypeAlias = dialect.MAVLink_message

STREAM_HZ: dict[int, float] = {  # rates to request; the first two streams are those that flying needs
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20.0,
    dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 2.0,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 2.0,
    dialect.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
}
ONCE = (dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION, dialect.MAVLINK_MSG_ID_HOME_POSITION)
SYNC_US = 200_000  # µs of vehicle time between two TIMESYNC requests
ANSWER_US = 1_000_000  # µs; in this time at the end, no TIMESYNC is requested while an earlier one waits for a reply
TRIES = 3  # attempts for a message that does not arrive by itself


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """One TIMESYNC request and its reply."""

    sent_ns: int  # this machine's monotonic clock
    answered_ns: int  # this machine's monotonic clock
    vehicle_ns: int  # the vehicle's clock, since its boot

    @property
    def length_s(self) -> float:
        return (self.answered_ns - self.sent_ns) * 1e-9

    @property
    def offset_ns(self) -> int:
        """The vehicle's clock minus this machine's monotonic clock (ns), if both directions take the same time."""
        return self.vehicle_ns - (self.sent_ns + self.answered_ns) // 2


@dataclass(frozen=True, slots=True)
class Observation:
    """The newest messages of a vehicle's autopilot, by message id, and measurements of its link."""

    newest: Mapping[int, Message] = field(default_factory=dict)
    seconds: float = 0.0  # s of vehicle time that the observation took
    counts: Mapping[int, int] = field(default_factory=dict)  # message id → number of messages in `seconds`
    worst_ratio: Mapping[str, float] = field(default_factory=dict)  # ESTIMATOR_STATUS test ratio → largest value
    texts: tuple[str, ...] = ()  # STATUSTEXT of severity warning or worse
    station: bool = False  # a heartbeat of a ground station arrived
    round_trips: tuple[RoundTrip, ...] = ()
    sync_requests: int = 0  # number of TIMESYNC requests
    unix_s: float = 0.0  # s, Unix time on this machine at the arrival of SYSTEM_TIME

    def message(self, name: str) -> Message | None:
        """Return the newest message of this name; None: none arrived."""
        return self.newest.get(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))

    @property
    def firmware(self) -> Firmware | None:
        """The firmware of AUTOPILOT_VERSION; None: it did not arrive."""
        message = self.message("AUTOPILOT_VERSION")
        return None if message is None else firmware(message)

    @property
    def sticks(self) -> bool:
        """Whether sticks reach the autopilot: its radio receiver is present and healthy."""
        status, bit = self.message("SYS_STATUS"), dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        if status is None:
            return False
        return bool(status.onboard_control_sensors_present & status.onboard_control_sensors_health & bit)


class Watch:
    """Collects the messages of a vehicle on a link."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._newest: dict[int, Message] = {}
        self._counts: Counter[int] = Counter()
        self._worst: dict[str, float] = {}
        self._texts = StatusTexts()
        self._station = False
        self._pending: set[int] = set()
        self._round_trips: list[RoundTrip] = []
        self._unix_s = 0.0
        self._began_us = 0

    def listen(self, seconds: float) -> Observation:
        """Request the streams of the checks, wait `seconds` of vehicle time, and return the observation.

        The streams keep their rates until the link is closed.
        """
        link = self._link
        with link.listening(self._take):
            for message_id, rate in STREAM_HZ.items():
                interval_us = round(1e6 / rate)
                link.streams.wanted.setdefault(message_id, interval_us)
                link.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)
            link.command(dialect.MAV_CMD_RUN_PREARM_CHECKS)  # makes PX4 send again why it would not arm
            self._counts.clear()
            self._began_us = link.time_us
            sync_us, end_us = 0, self._began_us + seconds * 1e6
            while link.time_us < end_us:
                if link.time_us >= sync_us and (link.time_us < end_us - ANSWER_US or not self._pending):
                    sync_us = link.time_us + SYNC_US
                    self._request_time()
                link.tick()
            observation = self._observation()
            self._request_missing()
            return replace(observation, newest=self._newest, worst_ratio=self._worst, unix_s=self._unix_s)

    def _request_missing(self) -> None:
        """Request each missing message. On a full link, a single message may arrive although its stream does not."""
        for message_id in (*ONCE, *STREAM_HZ):
            for _ in range(TRIES):
                if message_id in self._newest:
                    break
                self._link.command(dialect.MAV_CMD_REQUEST_MESSAGE, message_id)
                self._link.tick()

    def _observation(self) -> Observation:
        """Return the values that must not contain the answers to `_request_missing`."""
        return Observation(
            seconds=(self._link.time_us - self._began_us) * 1e-6,
            counts=dict(self._counts),
            texts=tuple(dict.fromkeys(text.text for text in self._texts.newest if text.severity <= 4)),
            station=self._station,
            round_trips=tuple(self._round_trips),
            sync_requests=len(self._pending) + len(self._round_trips),
        )

    def _request_time(self) -> None:
        now_ns = time.monotonic_ns()  # measures wall time
        self._pending.add(now_ns)
        self._link.send(dialect.MAVLink_timesync_message(0, now_ns))

    def _take(self, message: Message) -> None:
        kind = message.get_msgId()
        if (message.get_srcSystem(), message.get_srcComponent()) != (self._link.system, self._link.component):
            if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT and message.type == dialect.MAV_TYPE_GCS:
                self._station = True
            return
        self._newest[kind] = message
        self._counts[kind] += 1
        if kind == dialect.MAVLINK_MSG_ID_STATUSTEXT:
            self._texts.take(message, self._link.time_us)
        elif kind == dialect.MAVLINK_MSG_ID_TIMESYNC and message.ts1 in self._pending:
            self._pending.remove(message.ts1)
            self._round_trips.append(RoundTrip(message.ts1, time.monotonic_ns(), message.tc1))
        elif kind == dialect.MAVLINK_MSG_ID_SYSTEM_TIME:
            self._unix_s = time.time()
        elif kind == dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
            for name in ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"):
                self._worst[name] = max(self._worst.get(name, 0.0), getattr(message, name))
