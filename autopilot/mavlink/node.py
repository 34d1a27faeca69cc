"""The autopilot as a MAVLink component: its ports and streams, the clients' uploads, and its text messages.

A port is one MAVLink connection. It has its own stream rates, sequence numbers, and queue of bytes to send. TABLE lists
the streams: message, rate (Hz) on each kind of port, and maker (function that returns the fields). The rates are as
measured on PX4 1.15; 0 = only on request. A stream sends at most one message per call of `Port.tick` or `Port.stream`.

An upload is a plan that a client sends (`mission.py`). A missing item is requested again after 0.25 s, and a silent
client's upload is cancelled after 5 s, as in PX4.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from autopilot.commander.plans import PlanItem
from autopilot.logging.flight_log import FlightLogWriter
from autopilot.mavlink import motion_makers as motion
from autopilot.mavlink import status_makers as status
from autopilot.mavlink.file_tree import FileSessions, FileTree, packed
from autopilot.mavlink.gimbal import GimbalManager
from autopilot.mavlink.status_makers import Maker, Message, TelemetrySource
from foundation import wire
from foundation.errors import UsageError
from foundation.mavlink import Packer, Parser, dialect
from foundation.signing import Signing

PROFILES = ("onboard", "gcs", "minimal")  # kinds of ports; minimal streams only HEARTBEAT


@dataclass(frozen=True, slots=True)
class Stream:
    """One telemetry message, its rates and its maker."""

    name: str
    onboard: float  # Hz on PX4's port 14540
    gcs: float  # Hz on PX4's port 14550
    make: Maker

    @property
    def message_id(self) -> int:
        return int(getattr(dialect, f"MAVLINK_MSG_ID_{self.name}"))

    def rate(self, profile: str) -> float:
        """Return the default rate (Hz) on a port of this profile."""
        if self.name == "HEARTBEAT":
            return 1.0
        return {"onboard": self.onboard, "gcs": self.gcs}.get(profile, 0.0)


TABLE: tuple[Stream, ...] = (
    Stream("HEARTBEAT", 1, 1, status.heartbeat),
    Stream("ATTITUDE", 100, 50, motion.attitude),
    Stream("ATTITUDE_QUATERNION", 50, 50, motion.attitude_quaternion),
    Stream("GLOBAL_POSITION_INT", 50, 50, motion.global_position_int),
    Stream("HIGHRES_IMU", 50, 0, motion.highres_imu),
    Stream("LOCAL_POSITION_NED", 30, 50, motion.local_position_ned),
    Stream("ODOMETRY", 30, 0, motion.odometry),
    Stream("ATTITUDE_TARGET", 10, 50, motion.attitude_target),
    Stream("POSITION_TARGET_LOCAL_NED", 10, 50, motion.position_target_local_ned),
    Stream("SERVO_OUTPUT_RAW", 10, 50, motion.servo_output_raw),
    Stream("ALTITUDE", 10, 1, motion.altitude),
    Stream("VFR_HUD", 10, 4, motion.vfr_hud),
    Stream("DISTANCE_SENSOR", 10, 0.5, motion.distance_sensor),
    Stream("TIMESYNC", 10, 0, status.timesync),
    Stream("GPS_RAW_INT", 8, 5, motion.gps_raw_int),
    Stream("SYS_STATUS", 5, 1, status.sys_status),
    Stream("EXTENDED_SYS_STATE", 5, 1, status.extended_sys_state),
    Stream("RC_CHANNELS", 20, 20, status.rc_channels),
    Stream("ORBIT_EXECUTION_STATUS", 5, 2, motion.orbit_execution_status),
    Stream("ESTIMATOR_STATUS", 1, 0.5, motion.estimator_status),
    Stream("GPS_GLOBAL_ORIGIN", 1, 1, motion.gps_global_origin),
    Stream("SYSTEM_TIME", 1, 0, status.system_time),
    Stream("SCALED_PRESSURE", 1, 1, motion.scaled_pressure),
    Stream("MISSION_CURRENT", 1, 1, status.mission_current),
    Stream("PING", 1, 0.1, status.ping),
    Stream("BATTERY_STATUS", 0.5, 0.5, status.battery_status),
    Stream("HOME_POSITION", 0.5, 0.5, motion.home_position),
    Stream("CURRENT_MODE", 0.5, 0.5, status.current_mode),
    Stream("VIBRATION", 0.5, 0.1, motion.vibration),
    Stream("AVAILABLE_MODES_MONITOR", 0.3, 0.3, status.available_modes_monitor),
    Stream("GIMBAL_DEVICE_ATTITUDE_STATUS", 10, 5, status.of_gimbal(GimbalManager.attitude_status)),
    Stream("GIMBAL_MANAGER_STATUS", 5, 0.5, status.of_gimbal(GimbalManager.status)),
    Stream("GIMBAL_MANAGER_INFORMATION", 0, 0, status.of_gimbal(GimbalManager.information)),
    Stream("GIMBAL_DEVICE_INFORMATION", 0, 0, status.of_gimbal(GimbalManager.device_information)),
    Stream("AUTOPILOT_VERSION", 0, 0, status.autopilot_version),
    Stream("FLIGHT_INFORMATION", 0, 0, status.flight_information),
    Stream("SCALED_IMU", 0, 0, motion.scaled_imu),
    Stream("ACTUATOR_OUTPUT_STATUS", 0, 0, motion.actuator_output_status),
)

BY_ID: dict[int, Stream] = {stream.message_id: stream for stream in TABLE}
BY_NAME: dict[str, Stream] = {stream.name: stream for stream in TABLE}
HEARTBEAT_ID = int(dialect.MAVLINK_MSG_ID_HEARTBEAT)

# groups of streams (MAV_DATA_STREAM); older clients send REQUEST_DATA_STREAM instead of SET_MESSAGE_INTERVAL
GROUPS: dict[int, tuple[str, ...]] = {
    dialect.MAV_DATA_STREAM_RAW_SENSORS: ("HIGHRES_IMU", "SCALED_PRESSURE", "GPS_RAW_INT"),
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: ("SYS_STATUS", "EXTENDED_SYS_STATE", "GPS_RAW_INT", "MISSION_CURRENT"),
    dialect.MAV_DATA_STREAM_POSITION: ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    dialect.MAV_DATA_STREAM_EXTRA1: ("ATTITUDE",),
    dialect.MAV_DATA_STREAM_EXTRA2: ("VFR_HUD",),
    dialect.MAV_DATA_STREAM_RAW_CONTROLLER: ("SERVO_OUTPUT_RAW", "ATTITUDE_TARGET"),
}
GROUPS[dialect.MAV_DATA_STREAM_ALL] = tuple(sorted({name for names in GROUPS.values() for name in names}))


COMPONENT_ID = int(dialect.MAV_COMP_ID_AUTOPILOT1)
PARAMETER_LIST = "parameters"  # name of the transfer of the parameter list
# messages of each transfer per tick: with 100 ticks a second, a log is sent at 180 kB/s
TRANSFERS_PER_TICK = 20
PARAMETERS_PER_TICK = 18  # 1800 a second; PX4 sends 1000
TRANSFER_BACKLOG = 200  # messages; while the queue has this many or more, all transfers except parameters pause
FASTEST_US = 1_000  # least interval of a stream
ENCODING_ERRORS = (struct.error, OverflowError, ValueError)  # raised for a value that its field cannot hold
QUEUE_LIMIT = 20_000  # messages; a longer queue (its client reads nothing) loses its oldest half


def sender(message: Message) -> tuple[int, int]:
    """Return the system and the component that sent a message."""
    return message.get_srcSystem(), message.get_srcComponent()


class Port:
    """One MAVLink connection, without I/O: `receive` takes the received bytes, `take` returns the bytes to send."""

    def __init__(self, node: "Node", profile: str, number: int, handle: Callable[["Port", Message], None]) -> None:
        """`number` is the port's number in the component; `handle` is called for each received message."""
        if profile not in PROFILES:
            raise UsageError(f"Port profile {profile!r} does not exist; choose one of {', '.join(PROFILES)}.")
        self.profile = profile
        self.lost = 0  # number of messages that could not be encoded, or were dropped from a full queue
        self.transfers: dict[str, Iterator[Message]] = {}  # service → remaining messages of its transfer
        self.signing = Signing(number)
        self._node, self._handle = node, handle
        self.parser = Parser()
        self._packer = Packer(node.system_id, COMPONENT_ID)
        self._out: list[bytes] = []
        self._streams: dict[int, list[int]] = {}  # message id → [due µs, interval µs]
        self._next_due_us = 0  # earliest due time of all streams
        self.shortest_us = 1_000_000  # interval of the fastest stream
        for stream in TABLE:
            self.set_default_interval(stream.message_id)

    def receive(self, data: bytes) -> None:
        """Decode received bytes and handle their messages. Malformed bytes are counted and never raise an error."""
        before = self.parser.bad
        for message in self.parser.feed(data):
            if not self.signing.accepts(message, self._node.time_us):
                if self.signing.rejected == 1:
                    self._node.send_text(4, "MAVLink message without a valid signature ignored")
                continue
            self._handle(self, message)
            self._node.send_mode_changes()
        if before == 0 and self.parser.bad:
            self.note_malformed()

    def note_malformed(self) -> None:
        """Tell all clients that malformed bytes were received."""
        self._node.send_text(4, "Malformed MAVLink data received")

    def take(self) -> bytes:
        """Return all bytes queued since the last call."""
        data = b"".join(self._out)
        self._out.clear()
        return data

    def send(self, message: Message) -> None:
        """Queue a message."""
        try:
            frame = self._packer.pack(message)
        except ENCODING_ERRORS:
            self.lost += 1
        else:
            self._queue(frame, message.crc_extra)

    def _queue(self, frame: bytes, crc_extra: int) -> None:
        if self.signing.active:
            frame = self.signing.sign(frame, crc_extra, self._node.time_us)
        self._out.append(frame)
        if len(self._out) > QUEUE_LIMIT:
            self.lost += len(self._out) - QUEUE_LIMIT // 2
            del self._out[: -QUEUE_LIMIT // 2]

    def send_raw(self, data: bytes) -> None:
        """Queue a packed message of another component unchanged."""
        self._out.append(data)

    def send_heartbeat(self) -> None:
        """Queue a HEARTBEAT now; the next one follows a full interval later."""
        self.send_telemetry(HEARTBEAT_ID)
        self._streams[HEARTBEAT_ID][0] = self._node.time_us + self._streams[HEARTBEAT_ID][1]

    def telemetry(self, message_id: int) -> bytes | None:
        """Return the payload of a telemetry message at the present tick; None if it has no data."""
        return self._node.telemetry(message_id)

    def send_telemetry(self, message_id: int) -> None:
        """Queue one telemetry message now, if it has data."""
        try:
            payload = self.telemetry(message_id)
        except ENCODING_ERRORS:
            self.lost += 1
            return
        if payload is not None:
            layout = wire.BY_ID[message_id]
            self._queue(self._packer.frame(layout, payload), layout.extra[0])

    def set_interval(self, message_id: int, interval_us: int) -> None:
        """Set the interval (µs) of a stream; -1 stops it. HEARTBEAT keeps its rate."""
        if message_id == HEARTBEAT_ID:
            return
        if interval_us < 0:
            self._streams.pop(message_id, None)
        else:
            self._streams[message_id] = [self._node.time_us, max(interval_us, FASTEST_US)]
            self._next_due_us = 0
        self._find_shortest()

    def set_default_interval(self, message_id: int) -> None:
        """Stream a message at the default rate of the port's profile."""
        rate = BY_ID[message_id].rate(self.profile)
        if rate > 0.0:
            self._streams[message_id] = [self._node.time_us, round(1e6 / rate)]
            self._next_due_us = 0
        else:
            self._streams.pop(message_id, None)
        self._find_shortest()

    def interval_us(self, message_id: int) -> int:
        """Return the interval (µs) of a message's stream; -1 if there is none."""
        stream = self._streams.get(message_id)
        return stream[1] if stream is not None else -1

    def tick(self, now: int) -> None:
        """Queue the messages that are due at `now` (µs)."""
        if now >= self._next_due_us:
            self._send_due(now)
        if self.transfers:
            self._send_transfers()

    def stream(self, now: int) -> None:
        """Queue only the telemetry that is due. Called between two ticks, for streams faster than the ticks."""
        if now >= self._next_due_us:
            self._send_due(now)

    def _find_shortest(self) -> None:
        self.shortest_us = min(stream[1] for stream in self._streams.values())  # HEARTBEAT is always streamed
        self._node.find_shortest()

    def _send_due(self, now: int) -> None:
        for message_id, stream in self._streams.items():
            due = stream[0]
            if now >= due:
                interval = stream[1]
                # a stream that is late by an interval or more counts from now, and sends no burst
                stream[0] = due + interval if now - due < interval else now + interval
                self.send_telemetry(message_id)
        self._next_due_us = min((stream[0] for stream in self._streams.values()), default=now)

    def _send_transfers(self) -> None:
        for service, messages in list(self.transfers.items()):
            most = min(TRANSFERS_PER_TICK, TRANSFER_BACKLOG - len(self._out))
            for _ in range(PARAMETERS_PER_TICK if service == PARAMETER_LIST else most):
                message = next(messages, None)
                if message is None:
                    self.transfers.pop(service, None)
                    break
                self.send(message)


RETRY_US = 250_000
TIMEOUT_US = 5_000_000
MOST_UPLOADS = 16  # open uploads of all clients; the limit stops a hostile client from filling the memory
CANCELLED = int(dialect.MAV_MISSION_OPERATION_CANCELLED)

Key = tuple[int, int, int, int]  # port, system, component, mission type


@dataclass(slots=True)
class Upload:
    """A plan that a client is uploading."""

    port: Port
    client: tuple[int, int]
    kind: int
    count: int
    received_us: int
    requested_us: int
    items: list[PlanItem] = field(default_factory=list)
    taken_us: int | None = None  # time of completion; if the last item comes again, it is acknowledged again

    def request(self, now_us: int) -> None:
        self.requested_us = now_us
        self.port.send(dialect.MAVLink_mission_request_int_message(*self.client, len(self.items), self.kind))

    def acknowledge(self, result: int) -> None:
        self.port.send(dialect.MAVLink_mission_ack_message(*self.client, result, self.kind))


class Uploads:
    def __init__(self) -> None:
        self._open: dict[Key, Upload] = {}

    def begin(self, key: Key, upload: Upload) -> bool:
        """Start an upload; it replaces an older one with the same key. Returns False if MOST_UPLOADS are open."""
        if key not in self._open and len(self._open) >= MOST_UPLOADS:
            return False
        self._open[key] = upload
        return True

    def get(self, key: Key) -> Upload | None:
        return self._open.get(key)

    def end(self, key: Key) -> None:
        self._open.pop(key, None)

    def tick(self, now_us: int) -> None:
        """Request a missing item again; cancel an upload whose client is silent for TIMEOUT_US."""
        if not self._open:
            return
        for key, upload in list(self._open.items()):
            if now_us - upload.received_us >= TIMEOUT_US:
                if upload.taken_us is None:
                    upload.acknowledge(CANCELLED)
                self.end(key)
            elif upload.taken_us is None and now_us - upload.requested_us >= RETRY_US:
                upload.request(now_us)


TEXT_CHUNK = 50  # bytes, STATUSTEXT.text
REPEAT_US = 1_000_000  # the same complaint, for example about bad setpoints, is sent at most once a second

Inject = Callable[[int, int, int], bool]  # FAILURE_UNIT, FAILURE_TYPE, instance (0 = all) → whether it was applied


class Node:
    """The MAVLink component: the data and functions that all message handlers share."""

    def __init__(
        self,
        vehicle: TelemetrySource,
        system_id: int,
        log: FlightLogWriter | None = None,
        inject: Inject | None = None,
        card: Path | None = None,
    ) -> None:
        self.vehicle = vehicle
        self.inject = inject
        self.log = log
        self.files = FileTree(log.directory if log is not None else None, lambda: packed(vehicle.parameters), card)
        self.file_sessions = FileSessions()
        self.system_id = system_id
        self.ports: list[Port] = []
        self.reboot_requested = False
        self.handler_errors = 0
        self.uploads = Uploads()
        self.shortest_us = 1_000_000  # the interval of the fastest stream of all ports
        self._text_id = 0
        self._shown = (vehicle.commander.mode, vehicle.commander.armed)
        self._complained: dict[str, int] = {}
        self._made_us = -1
        self._made: dict[int, bytes | None] = {}

    @property
    def time_us(self) -> int:
        return self.vehicle.state.time_us

    def find_shortest(self) -> None:
        """Update `shortest_us` after a port was opened or closed, or has changed its rates."""
        self.shortest_us = min((port.shortest_us for port in self.ports), default=1_000_000)

    def telemetry(self, message_id: int) -> bytes | None:
        """Return the payload of a message at the present tick, made once for all ports; None if it has no data.

        Raises one of ENCODING_ERRORS.
        """
        now = self.vehicle.state.time_us
        if self._made_us != now:
            self._made_us = now
            self._made.clear()
        try:
            return self._made[message_id]
        except KeyError:
            fields = BY_ID[message_id].make(self.vehicle)
            payload = None if fields is None else wire.BY_ID[message_id].payload_of(fields)
            self._made[message_id] = payload
            return payload

    def forget_telemetry(self) -> None:
        """Discard the payloads of this tick, because a value has changed within the tick."""
        self._made.clear()

    def broadcast(self, message: Message) -> None:
        """Send a message on every port."""
        for port in self.ports:
            port.send(message)

    def forward(self, source: Port, data: bytes) -> None:
        """Forward a client's message to the other ports, as PX4 does, except to ports of the minimal profile."""
        for port in self.ports:
            if port is not source and port.profile != "minimal":
                port.send_raw(data)

    def send_mode_changes(self) -> None:
        """Send HEARTBEAT at once on every port if the mode or the armed state has changed since the last call."""
        commander = self.vehicle.commander
        shown = (commander.mode, commander.armed)
        if shown == self._shown:
            return
        self._shown = shown
        self.forget_telemetry()
        for port in self.ports:
            port.send_heartbeat()

    def send_text(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT on every port, in chunks when it is longer than one message holds."""
        for message in self.texts(severity, text):
            self.broadcast(message)
        if self.log is not None:
            self.log.log_text(severity, text)

    def complain(self, text: str) -> None:
        """Send a text about a fault of a client's messages; the same text at most once a second of vehicle time."""
        last = self._complained.get(text)
        if last is None or self.time_us - last >= REPEAT_US:
            if len(self._complained) > 64:
                self._complained.clear()
            self._complained[text] = self.time_us
            self.send_text(dialect.MAV_SEVERITY_CRITICAL, text)

    def texts(self, severity: int, text: str) -> list[Message]:
        """Return the STATUSTEXT messages that carry `text`; id 0 means that one message has the whole text."""
        data = text.encode("ascii", "replace")
        chunks = [data[i : i + TEXT_CHUNK] for i in range(0, len(data), TEXT_CHUNK)] or [b""]
        if len(chunks) == 1:
            return [dialect.MAVLink_statustext_message(severity, chunks[0], 0, 0)]
        self._text_id = self._text_id % 65535 + 1
        if len(chunks[-1]) == TEXT_CHUNK:
            chunks.append(b"")  # a receiver recognises the last chunk by its terminating zero
        return [
            dialect.MAVLink_statustext_message(severity, chunk, self._text_id, i)
            for i, chunk in enumerate(chunks[:256])
        ]
