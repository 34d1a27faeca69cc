"""The newest telemetry of a vehicle as one frozen state, its status texts, and its clock."""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import NamedTuple

from foundation.frames import Vec3
from foundation.mavlink import dialect, mode_name

WARNING = dialect.MAV_SEVERITY_WARNING  # 4; smaller is worse
KEPT = 50  # texts that are kept
PIECE = 50  # characters that one STATUSTEXT holds


@dataclass(frozen=True, slots=True)
class ReceivedText:
    """One text of an autopilot."""

    time_us: int  # µs, the vehicle's clock at the newest telemetry before the text
    severity: int  # MAV_SEVERITY
    text: str


class StatusTexts:
    """The newest texts of one autopilot."""

    def __init__(self) -> None:
        self.newest: deque[ReceivedText] = deque(maxlen=KEPT)
        self._open: ReceivedText | None = None  # a text that may still miss a piece
        self._open_id = 0  # STATUSTEXT.id of that text

    def take(self, message: dialect.MAVLink_message, time_us: int) -> None:
        """Take a STATUSTEXT. A text ends with a piece that is not full, when another text begins, or at a read."""
        text = _plain(message.text)
        if message.id != self._open_id or message.chunk_seq == 0:
            self._complete()
        before = self._open.text if self._open is not None else ""
        self._open, self._open_id = ReceivedText(time_us, message.severity, before + text), message.id
        if not message.id or len(text) < PIECE:
            self._complete()

    def _complete(self) -> None:
        if self._open is not None:
            self.newest.append(replace(self._open, text=" ".join(self._open.text.split())))
            self._open = None

    def since(self, time_us: int) -> str:
        """Return the texts since `time_us` of severity warning or worse, in order and joined; empty: none."""
        self._complete()
        texts = [text.text for text in self.newest if text.time_us >= time_us and text.severity <= WARNING]
        return "; ".join(dict.fromkeys(texts))

    def last(self) -> str:
        """Return the newest text of severity warning or worse; empty: none."""
        self._complete()
        return next((text.text for text in reversed(self.newest) if text.severity <= WARNING), "")


def _plain(text: str | bytes) -> str:
    decoded = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return decoded.split("\0", 1)[0]


WRAP_MS = 1 << 32  # time_boot_ms is a uint32
FAR_MS = 60_000  # ms; a stamp further ahead than this, or one after a reboot, counts only if others confirm it
LATE_MS = 5_000  # a stamp that is older than the newest by more than this is not from a late packet
CONFIRMED = 5  # number of stamps in a row that must agree, to confirm a stamp
CONFIRMED_S = 0.3  # s that must pass from the first to the last of these stamps, unless they come from a recording


class _Doubt(NamedTuple):
    """Stamps that contradict the vehicle's clock."""

    newest_ms: int
    since_s: float | None
    seen: int


class VehicleClock:
    """µs since boot from time_boot_ms, with its wrap after 49 days. It runs backwards only at a reboot.

    After a reboot, the stamps are smaller than before. They are also smaller in delayed messages and after the wrap.
    The time since the last arrival tells the three cases apart. After a reboot, the stamp is smaller than this time.
    After a wrap, the stamp has advanced by at most this time. Any other smaller stamp is from a delayed message. Both
    comparisons add FAR_MS to this time, because the last stamp may have been late.
    """

    def __init__(self) -> None:
        self.time_us = 0
        self.reboots = 0
        self._last_ms: int | None = None
        self._last_received_s: float | None = None  # arrival of the stamp `_last_ms`
        self._doubt: _Doubt | None = None

    def see(self, time_boot_ms: int, received_s: float | None = None) -> None:
        """Record a time stamp; `received_s`: its arrival by the transport's clock; None: it is from a recording."""
        if self._last_ms is None:
            self._last_ms, self._last_received_s, self.time_us = time_boot_ms, received_s, time_boot_ms * 1000
            return
        ahead_ms = _between(self._last_ms, time_boot_ms)
        rebooted = self._shows_reboot(self._last_ms, time_boot_ms, received_s)
        if ahead_ms < 0 and not rebooted:
            if ahead_ms >= -LATE_MS:
                self._doubt = None
            return  # a late packet
        # a damaged stamp must not stop the clock forever, and a forged one must not end the flight
        if (rebooted or ahead_ms > FAR_MS) and not self._is_confirmed(time_boot_ms, received_s):
            return
        self._doubt, self._last_ms, self._last_received_s = None, time_boot_ms, received_s
        if rebooted:
            self.reboots += 1
            self.time_us = time_boot_ms * 1000
        else:
            self.time_us += ahead_ms * 1000

    def _shows_reboot(self, last_ms: int, time_boot_ms: int, received_s: float | None) -> bool:
        """Return whether a stamp shows that the vehicle has rebooted since the stamp `last_ms`."""
        ahead_ms = _between(last_ms, time_boot_ms)
        if time_boot_ms >= last_ms or -LATE_MS <= ahead_ms < 0:
            return False
        if received_s is None or self._last_received_s is None:  # without arrivals, a long gap at the wrap is unlikely
            return ahead_ms < 0 or ahead_ms > FAR_MS
        # in lockstep, arrivals are by the vehicle's clock, which a reboot sets back
        longest_ms = FAR_MS + max(received_s - self._last_received_s, 0.0) * 1000.0
        return time_boot_ms < longest_ms and not 0 <= ahead_ms <= longest_ms

    def _is_confirmed(self, time_boot_ms: int, received_s: float | None) -> bool:
        doubt = self._doubt
        if doubt is None or abs(_between(doubt.newest_ms, time_boot_ms)) > LATE_MS:
            doubt = _Doubt(time_boot_ms, received_s, 0)
        self._doubt = _Doubt(time_boot_ms, doubt.since_s, doubt.seen + 1)
        lasts = received_s is None or doubt.since_s is None or received_s - doubt.since_s >= CONFIRMED_S
        return lasts and self._doubt.seen >= CONFIRMED

    def of(self, time_boot_ms: int) -> int | None:
        """Return the time (µs, vehicle clock) of a stamp that was just seen. It may be before `time_us`.

        None: the message must be ignored, because its stamp is older than the newest by more than LATE_MS. After a
        reboot, this ends when the reboot is confirmed.
        """
        late_ms = 0 if self._last_ms is None else _between(time_boot_ms, self._last_ms)
        if late_ms > LATE_MS:
            return None
        return self.time_us - max(late_ms, 0) * 1000


def _between(earlier_ms: int, later_ms: int) -> int:
    """Return the ms from one stamp to another, the shorter way around the wrap; negative: backwards."""
    return (later_ms - earlier_ms + WRAP_MS // 2) % WRAP_MS - WRAP_MS // 2


class VehicleState(NamedTuple):
    """The newest value of each quantity; None: none has arrived yet."""

    armed: bool = False
    mode: str = ""
    overridden_mode: str = ""  # requested mode, while a failsafe has activated `mode` instead; else empty
    mode_us: int = 0  # µs, vehicle clock at the last message with the mode
    heartbeat_us: int = 0  # µs, vehicle clock at the last heartbeat
    system_status: int = 0
    position_ned: Vec3 | None = None  # m, local frame of the autopilot
    position_us: int = 0  # µs, vehicle clock when the position was valid, not when it arrived
    velocity_ned: Vec3 | None = None  # m/s
    euler: Vec3 | None = None  # rad, roll pitch yaw
    yaw_rate: float | None = None  # rad/s, + right
    attitude_us: int = 0  # µs, vehicle clock when the attitude was valid, not when it arrived
    landed: bool | None = None
    healthy: bool = False  # ready to arm: the pre-arm check and the sensors that flying needs
    origin: Vec3 | None = None  # lat °, lon °, alt m of the local frame
    home_ned: Vec3 | None = None  # m, home in the local frame
    battery_remaining: float | None = None  # 0 … 1
    battery_voltage: float | None = None  # V
    gps_fix: int | None = None
    range_m: float | None = None  # m, of a rangefinder that looks down


NO_VELOCITY = (  # bits of a setpoint's mask that ignore the velocity: north, east, down
    dialect.POSITION_TARGET_TYPEMASK_VX_IGNORE,
    dialect.POSITION_TARGET_TYPEMASK_VY_IGNORE,
    dialect.POSITION_TARGET_TYPEMASK_VZ_IGNORE,
)

PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
SENSORS = 0x1 | 0x2 | 0x4  # gyro, accelerometer, magnetometer


STATE_MESSAGES = frozenset(  # the messages that change the state
    {
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_ATTITUDE,
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_CURRENT_MODE,
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
        dialect.MAVLINK_MSG_ID_HOME_POSITION,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR,
    }
)


def update(
    state: VehicleState, message: dialect.MAVLink_message, time_us: int = 0, received_us: int | None = None
) -> VehicleState:
    """Return the state after a message of the autopilot component. `time_us`: the time of the message, vehicle clock.

    `received_us`: the message's arrival by the vehicle's clock, on a link with known delay; None: no delay. Poses get
    `time_us`, mode and heartbeat get `received_us`. A pose is ignored if it is older than the newest pose or contains a
    NaN, which would pass every limit. The last valid pose then becomes stale.
    """
    received_us = time_us if received_us is None else received_us
    match message.get_msgId():
        case dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            finite = _finite(message.x, message.y, message.z, message.vx, message.vy, message.vz)
            if not finite or time_us < state.position_us:
                return state
            return state._replace(
                position_ned=(message.x, message.y, message.z),
                velocity_ned=(message.vx, message.vy, message.vz),
                position_us=time_us,
            )
        case dialect.MAVLINK_MSG_ID_ATTITUDE:
            if not _finite(message.roll, message.pitch, message.yaw) or time_us < state.attitude_us:
                return state
            return state._replace(
                euler=(message.roll, message.pitch, message.yaw),
                yaw_rate=message.yawspeed if math.isfinite(message.yawspeed) else None,
                attitude_us=time_us,
            )
        case dialect.MAVLINK_MSG_ID_HEARTBEAT:
            mode = mode_name(message.custom_mode)
            return state._replace(
                armed=bool(message.base_mode & 128),
                mode=mode,
                overridden_mode=state.overridden_mode if mode == state.mode else "",
                mode_us=received_us,
                heartbeat_us=received_us,
                system_status=message.system_status,
            )
        case dialect.MAVLINK_MSG_ID_CURRENT_MODE:
            intended = message.intended_custom_mode  # 0: not supported
            overridden = intended not in (0, message.custom_mode)
            return state._replace(
                mode=mode_name(message.custom_mode),
                mode_us=received_us,
                overridden_mode=mode_name(intended) if overridden else "",
            )
        case dialect.MAVLINK_MSG_ID_SYS_STATUS:
            health = message.onboard_control_sensors_health
            return state._replace(
                healthy=health & PREARM != 0 and health & SENSORS == SENSORS,
                battery_remaining=message.battery_remaining / 100 if message.battery_remaining >= 0 else None,
                battery_voltage=message.voltage_battery / 1000 if message.voltage_battery != 65535 else None,
            )
        case dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            landed = {1: True, 2: False, 3: False, 4: False}.get(message.landed_state)
            return state if landed is None else state._replace(landed=landed)
        case dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            origin = (message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)
            return state._replace(origin=origin)
        case dialect.MAVLINK_MSG_ID_HOME_POSITION:
            if not _finite(message.x, message.y, message.z):
                return state
            return state._replace(home_ned=(message.x, message.y, message.z))
        case dialect.MAVLINK_MSG_ID_GPS_RAW_INT:
            return state._replace(gps_fix=message.fix_type)
        case dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
            if message.orientation != dialect.MAV_SENSOR_ROTATION_PITCH_270:
                return state
            valid = message.min_distance <= message.current_distance <= message.max_distance
            return state._replace(range_m=message.current_distance / 100 if valid else None)
    return state


def _finite(*values: float) -> bool:
    return all(map(math.isfinite, values))


def setpoint_velocity(message: dialect.MAVLink_message) -> Vec3:
    """Return the velocity (m/s, NED) of a POSITION_TARGET_LOCAL_NED; 0 along the axes that it ignores."""
    velocity = (message.vx, message.vy, message.vz)
    north, east, down = (
        0.0 if message.type_mask & mask or not math.isfinite(v) else float(v)
        for v, mask in zip(velocity, NO_VELOCITY, strict=True)
    )
    return (north, east, down)
