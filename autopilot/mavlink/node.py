"""The autopilot as a MAVLink component: its ports, what they share, and the texts it sends to all of them.

What they share includes plans on their way in, one per client: an upload is collected apart and put in force as a
whole. Source: mavlink.io/en/services/mission.html; retry 0.25 s, time-out 5 s as PX4.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from autopilot.commander.plans import PlanItem
from autopilot.logging.flight_log import FlightLogWriter
from autopilot.mavlink.file_tree import FileSessions, FileTree, packed
from autopilot.mavlink.port import BY_ID, Port
from autopilot.mavlink.status_makers import Message, TelemetrySource
from foundation.mavlink import dialect

RETRY_US = 250_000
TIMEOUT_US = 5_000_000
MOST_UPLOADS = 16  # at once, of all clients; a hostile client cannot fill the memory
CANCELLED = int(dialect.MAV_MISSION_OPERATION_CANCELLED)

Key = tuple[int, int, int, int]  # port, system, component, mission type


@dataclass(slots=True)
class Upload:
    """A plan on its way in."""

    port: Port
    client: tuple[int, int]
    kind: int
    count: int
    received_us: int
    requested_us: int
    items: list[PlanItem] = field(default_factory=list)
    taken_us: int | None = None  # when it was complete: a repeated last item is then acknowledged again

    def request(self, now_us: int) -> None:
        """Request the next item."""
        self.requested_us = now_us
        self.port.send(dialect.MAVLink_mission_request_int_message(*self.client, len(self.items), self.kind))

    def acknowledge(self, result: int) -> None:
        self.port.send(dialect.MAVLink_mission_ack_message(*self.client, result, self.kind))


class Uploads:
    """The uploads of all clients."""

    def __init__(self) -> None:
        self._open: dict[Key, Upload] = {}

    def begin(self, key: Key, upload: Upload) -> bool:
        """Start an upload in the place of an older one of the same client. Returns False when there are too many."""
        if key not in self._open and len(self._open) >= MOST_UPLOADS:
            return False
        self._open[key] = upload
        return True

    def get(self, key: Key) -> Upload | None:
        return self._open.get(key)

    def end(self, key: Key) -> None:
        self._open.pop(key, None)

    def tick(self, now_us: int) -> None:
        """Ask again for what did not come; give up on a client that has gone."""
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
REPEAT_US = 1_000_000  # a complaint about a stream of bad setpoints is said once a second

Inject = Callable[[int, int, int], bool]  # FAILURE_UNIT, FAILURE_TYPE, instance (0 = all) → whether it can be done


class Node:
    """The component, as every service uses it."""

    def __init__(
        self,
        vehicle: TelemetrySource,
        system_id: int,
        uploads: Uploads,
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
        self.uploads = uploads
        self.shortest_us = 1_000_000  # the interval of the fastest stream of all ports
        self._text_id = 0
        self._shown = (vehicle.commander.mode, vehicle.commander.armed)
        self._complained: dict[str, int] = {}
        self._made_us = -1
        self._made: dict[int, Message | None] = {}

    @property
    def time_us(self) -> int:
        return self.vehicle.state.time_us

    def find_shortest(self) -> None:
        """Look which stream is the fastest: a port has changed its rates, come or gone."""
        self.shortest_us = min((port.shortest_us for port in self.ports), default=1_000_000)

    def telemetry(self, message_id: int) -> Message | None:
        """Return the message of the present tick, made once for all ports; None when there is nothing to tell."""
        if self._made_us != self.time_us:
            self._made_us = self.time_us
            self._made.clear()
        try:
            return self._made[message_id]
        except KeyError:
            message = self._made[message_id] = BY_ID[message_id].make(self.vehicle)
            return message

    def forget_telemetry(self) -> None:
        """Make messages afresh: something has changed within the tick."""
        self._made.clear()

    def broadcast(self, message: Message) -> None:
        """Send on every port."""
        for port in self.ports:
            port.send(message)

    def forward(self, source: Port, data: bytes) -> None:
        """Pass a message of somebody else on to the other links, as PX4 does; a minimal port hears the vehicle only."""
        for port in self.ports:
            if port is not source and port.profile != "minimal":
                port.send_raw(data)

    def show_mode(self) -> None:
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
        """Say something about a client's traffic, the same text at most once a second of vehicle time."""
        last = self._complained.get(text)
        if last is None or self.time_us - last >= REPEAT_US:
            if len(self._complained) > 64:
                self._complained.clear()
            self._complained[text] = self.time_us
            self.send_text(dialect.MAV_SEVERITY_CRITICAL, text)

    def texts(self, severity: int, text: str) -> list[Message]:
        """Return the STATUSTEXT messages that carry `text`; id 0 marks one that is whole."""
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
