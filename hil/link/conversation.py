"""Handles the messages of a link to one autopilot: telemetry, the vehicle's clock, commands, requested streams."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator

from foundation.errors import LinkError
from foundation.frames import quat_normalized, quat_to_euler
from foundation.mavlink import PX4_AUTOPILOT, Packer, Parser, dialect, frame_of
from foundation.signing import Signing, is_signed, timestamp
from hil.link.autopilots import Firmware, firmware, kind_name
from hil.link.course import PoseHistory
from hil.link.streams import TICK_US, Streams
from hil.link.telemetry import STATE_MESSAGES, StatusTexts, VehicleClock, VehicleState, update
from hil.link.transport import Transport

REPLACED_S = 3.0  # s of the transport's clock without a message, after which the vehicle's address may change
NOTICE_S = 10.0  # s between two notices of ignored messages


class VehicleAddress:
    """Parses the bytes of the vehicle and of other senders separately, and finds the vehicle's messages.

    A UDP port receives from every sender. The class holds the source of the vehicle's first heartbeat as the vehicle's
    address. It ignores messages with the vehicle's ids from other addresses. After REPLACED_S without a message from
    the held address, another address may replace it, because a restarted bridge has another port.
    """

    def __init__(self, transport: Transport, notice: Callable[[str], None]) -> None:
        """`notice` receives a line for the user when another address sends with the vehicle's ids."""
        self._transport, self._notice = transport, notice
        self._held: str | None = None
        self._parser = Parser()  # for the bytes of the held address
        self._stranger: str | None = None  # the last other address that sent
        self._stranger_parser = Parser()
        self._confirmed_s = 0.0  # when the held address last sent
        self._noticed_s = -math.inf

    def messages(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Return the messages that end in `data`, the bytes of the last `receive`."""
        peer = self._transport.peer
        if peer == self._held:
            return self._parser.feed(data)
        if peer != self._stranger:
            self._stranger, self._stranger_parser = peer, Parser()
        return self._stranger_parser.feed(data)

    def hold(self) -> None:
        """Hold the address of the last `receive` as the vehicle's."""
        self._held, self._confirmed_s = self._transport.peer, self._transport.time_s()
        self._parser, self._stranger, self._stranger_parser = self._stranger_parser, None, Parser()
        self._transport.follow(self._held)

    def admits(self) -> bool:
        """Return whether the vehicle may have sent the message just received, which has the vehicle's ids."""
        peer, now_s = self._transport.peer, self._transport.time_s()
        if peer != self._held:
            silent_s = now_s - self._confirmed_s
            if silent_s < REPLACED_S:
                if now_s >= self._noticed_s + NOTICE_S:
                    self._noticed_s = now_s
                    self._notice(f"{peer} sends messages with the id of the vehicle at {self._held}; ignored")
                return False
            self._notice(f"the vehicle now speaks from {peer}; {self._held} has been silent for {silent_s:.1f} s")
            self.hold()
        self._confirmed_s = now_s
        return True


SYSTEM, COMPONENT = 245, 191  # MAV_COMP_ID_ONBOARD_COMPUTER; a ground station keeps 255/190
SILENCE_S = 5.0  # s of the transport's clock without telemetry after which the vehicle is gone
LOST_S = 1.0  # replaces SILENCE_S once the vehicle is gone, so that later orders fail sooner
WARNING_S = 1.0  # s of the transport's clock; a longer silence is reported to the user
CHECK = ". Check that the vehicle or simulator runs, and that the URL is right"
PATIENCE_S = 0.5  # longest wait of one read, in s of the transport's clock
GAP_US = 500_000  # µs of vehicle time without telemetry after which the last mode is not trusted
AWAY_S = 0.5  # s of the transport's clock between two sends; after a longer pause, received bytes are read first
ASK_AGAIN_S = 1.5  # s of the transport's clock between requests in `connect`; a first position takes about a second
COMMAND_RETRY_US = 500_000
COMMAND_TRIES = 6
KEY_TRIES = 5
AGAIN_S = 0.5  # s of vehicle time before a temporarily rejected command is sent again
HEARTBEAT_TICKS = 100  # ticks to wait for a heartbeat, 5 s at 20 Hz; PX4 sends one a second
WORDS_S = 0.3  # s of vehicle time to wait for the text with the reason for a refusal
AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
HEARTBEAT, COMMAND_ACK = dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_COMMAND_ACK
STATUSTEXT, VERSION = dialect.MAVLINK_MSG_ID_STATUSTEXT, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
GIMBAL = dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS
# each of these messages advances the vehicle's clock
STAMPED = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE, GIMBAL}
HANDLED = STATE_MESSAGES | {COMMAND_ACK, STATUSTEXT, VERSION, GIMBAL}  # other messages are only for listeners
RESULTS = {
    1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 5: "in progress", 6: "cancelled",
}  # fmt: skip
# by the standard, unused parameters of these commands are 0; those of other commands may be NaN ("use the default")
ZERO_FILLED = {dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_REQUEST_MESSAGE}


class Conversation:
    """Receives telemetry and sends commands, on the vehicle's clock. Only this class advances the clock."""

    def __init__(
        self,
        transport: Transport,
        *,
        silence_s: float = SILENCE_S,
        key: bytes = b"",
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        """`silence_s`: s of the transport's clock without telemetry after which the vehicle is gone.

        `key`: 32 bytes to sign and check messages; empty: no signatures. `unix_s` returns the Unix time (s) for the
        first timestamp of the signatures.
        """
        self.transport = transport
        self.behind_us = 0  # µs, known delay of all telemetry, such as the declared delay of a simulated link
        self.tick_us = TICK_US  # µs of vehicle time between two ticks
        self.state = VehicleState()
        self.clock = VehicleClock()
        self.track = PoseHistory()
        self.firmware: Firmware | None = None
        self.system = 0
        self.component = AUTOPILOT
        self.streams = Streams()
        self.texts = StatusTexts()
        self.listeners: list[Callable[[dialect.MAVLink_message], None]] = []  # get every message of the link
        self.on_wait: Callable[[], None] = lambda: None  # called at every read of a wait; may raise to end the wait
        self.on_silence: Callable[[float], None] = lambda seconds: None  # receives the length of a silence, s
        self.on_notice: Callable[[str], None] = lambda line: None  # receives lines for the user
        self._silence_s, self._time_s = silence_s, transport.time_s
        self._lost = False  # whether the vehicle was silent for `silence_s`, and has sent nothing since
        self._address = VehicleAddress(transport, lambda line: self.on_notice(line))
        self._packer = Packer(SYSTEM, COMPONENT)
        self._unix_s = unix_s
        self._signing = Signing(0)
        self._vehicle_signs = False  # whether the autopilot signed its last message
        self._heartbeat_due_us = 0
        self._tick_due_us = 0
        self._gap_us = 0  # µs, vehicle clock when telemetry came back after its last gap
        self._boots = 0
        self._spoke_s = self._time_s()
        self._ack: dialect.MAVLink_message | None = None
        self._sign_with(key)

    @contextlib.contextmanager
    def listening(self, listener: Callable[[dialect.MAVLink_message], None]) -> Iterator[None]:
        """Call a listener with every message of the link until the context ends."""
        self.listeners.append(listener)
        try:
            yield
        finally:
            self.listeners.remove(listener)

    def copy_to(self, transport: Transport) -> None:
        """Send a copy of every later message of the vehicle's system to another transport.

        A port may also receive messages of other vehicles, which a log of this vehicle must not contain.
        """

        def copy(message: dialect.MAVLink_message) -> None:
            if message.get_srcSystem() == self.system:
                transport.send(bytes(message.get_msgbuf()))

        self.listeners.append(copy)

    # -- the wire ------------------------------------------------------------------------------------------------

    def connect(self, timeout_s: float = 30.0) -> None:
        """Wait for the autopilot's heartbeat and telemetry, then up to 1 s for its version. Ask for the needed streams.

        Raises LinkError if no autopilot answers within `timeout_s` (transport clock), or if the autopilot is not PX4.
        """
        began_s, requested_s, complete_s, system = self._time_s(), -math.inf, math.inf, self.system
        while not self._has_telemetry() or (self.firmware is None and self._time_s() < complete_s + 1.0):
            now_s = self._time_s()
            # not at every pass, because a request restarts the message's interval
            if now_s >= requested_s + ASK_AGAIN_S or system != self.system:
                requested_s, system = now_s, self.system
                self._send_heartbeat()
                if self.system:
                    self._request_streams()
            self._receive(0.5)
            self._boots = self.clock.reboots  # a reboot during `connect` does not end it
            if self._has_telemetry():
                complete_s = min(complete_s, self._time_s())
            self.on_wait()
            if self._time_s() >= began_s + timeout_s and not self._has_telemetry():
                missing = "no telemetry" if self.system else "no MAVLink heartbeat of an autopilot"
                raise LinkError(
                    f"{missing} on {self.transport.url} within {timeout_s:g} s{self._why_unheard() or CHECK}"
                )
        # the first heartbeat came before the clock was known, so it counts as received now
        self.state = self.state._replace(heartbeat_us=max(self.state.heartbeat_us, self.time_us))
        self._request_streams()

    def _has_telemetry(self) -> bool:
        return bool(self.system) and self.state.position_ned is not None and self.state.euler is not None

    def send(self, message: dialect.MAVLink_message) -> None:
        frame = self._packer.pack(message)
        self.transport.send(
            self._signing.sign(frame, message.crc_extra, self._wire_us) if self._signing.active else frame
        )

    def close(self) -> None:
        """Set every stream that we changed back to the autopilot's own rate, and close the link."""
        with contextlib.suppress(LinkError):  # a broken link cannot send
            for interval in self.streams.all() if self.system else ():
                self._request(interval.message_id, 0)
        self.transport.close()

    def _receive(self, timeout_s: float) -> bool:
        data = self.transport.receive(timeout_s)
        for message in self._address.messages(data) if data else ():
            if self._is_credible(message):
                self._take(message)
        return bool(data)

    def _is_credible(self, message: dialect.MAVLink_message) -> bool:
        """Return whether a message just received may come from the sender that its ids name."""
        if self._signing.active and not self._signing.accepts(message, self._wire_us):
            return False
        is_vehicle = message.get_srcSystem() == self.system and message.get_srcComponent() == AUTOPILOT
        return not self.system or not is_vehicle or self._address.admits()

    def _take(self, message: dialect.MAVLink_message) -> None:
        for listener in self.listeners:
            listener(message)
        if message.get_srcComponent() != AUTOPILOT:
            return
        kind = message.get_msgId()
        if kind == HEARTBEAT and not self.system:
            self._meet(message)
        if message.get_srcSystem() != self.system:
            return
        frame = frame_of(message)
        self._vehicle_signs = is_signed(frame)
        self.streams.saw(kind, len(frame))
        if kind not in HANDLED:
            return
        if kind == COMMAND_ACK:
            if message.target_system in (0, SYSTEM) and message.target_component in (0, COMPONENT):
                self._ack = message
            return
        if kind == VERSION:
            self.firmware = firmware(message)
            return
        stamp_us: int | None = self.clock.time_us
        if kind in STAMPED:
            before_us = self.time_us
            self.clock.see(message.time_boot_ms, self._time_s())
            if self.clock.reboots != self._boots:
                self.state, self._gap_us = VehicleState(), self.time_us
            elif self.time_us - before_us > GAP_US:
                self._gap_us = self.time_us
            stamp_us = self.clock.of(message.time_boot_ms)
        if stamp_us is None:
            return
        if kind == GIMBAL:
            pitch = quat_to_euler(quat_normalized(tuple(message.q)))[1]
            self.track.gimbal(stamp_us, pitch)
            return
        if kind == STATUSTEXT:
            self.texts.take(message, self.time_us)
        before = self.state
        self.state = update(before, message, stamp_us, self.time_us)
        if kind in STAMPED:
            brought = self.state
            if brought is before:  # the message is older than the newest one, but the history needs its pose
                brought = update(VehicleState(), message, stamp_us)
            self._track(kind, brought)
        elif kind == dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR and self.state.range_m is not None:
            self.track.range(self.clock.time_us, self.state.range_m)
        self._noticed()

    def _track(self, kind: int, state: VehicleState) -> None:
        """Add the place or attitude in `state` to the history; `kind`: id of its message."""
        if kind == dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            if state.position_ned is not None and state.velocity_ned is not None:
                self.track.place(state.position_us, state.position_ned, state.velocity_ned)
        elif state.euler is not None:
            self.track.heading(state.attitude_us, state.euler[2], state.yaw_rate or 0.0)
            self.track.tilt(state.attitude_us, state.euler[0], state.euler[1])

    def _meet(self, heartbeat: dialect.MAVLink_message) -> None:
        if heartbeat.autopilot == dialect.MAV_AUTOPILOT_INVALID:
            return
        if heartbeat.autopilot != PX4_AUTOPILOT:
            raise LinkError(
                f"{kind_name(heartbeat.autopilot)} answers on {self.transport.url}, but dronecats flies PX4 only."
                " Connect a vehicle that runs PX4"
            )
        self.system = heartbeat.get_srcSystem()
        self._address.hold()

    def _noticed(self) -> None:
        """Called after every change of the state, for subclasses."""

    def _request_streams(self) -> None:
        for interval in self.streams.all():
            self._request(interval.message_id, interval.interval_us)
        self._request_once()

    def _request_once(self) -> None:
        for message_id in self.streams.once():
            self.send(self._command_long(dialect.MAV_CMD_REQUEST_MESSAGE, (message_id,)))

    def _request(self, message_id: int, interval_us: int) -> None:
        self.send(self._command_long(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (message_id, interval_us)))

    def _send_heartbeat(self) -> None:
        # as a ground station, because PX4 sends STATUSTEXT only on a link with one
        self.send(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
            )
        )

    # -- signing -------------------------------------------------------------------------------------------------

    @property
    def _wire_us(self) -> int:
        return round(self._time_s() * 1e6)

    @property
    def has_key(self) -> bool:
        """Whether messages are signed, and unsigned messages are ignored."""
        return self._signing.active

    def _sign_with(self, key: bytes) -> None:
        if key:
            self._signing.set_up(key, timestamp(self._unix_s()), self._wire_us)

    def _why_unheard(self) -> str:
        """Return the end of an error message if signing causes the silence; empty if signing is not the cause."""
        signing = self._signing
        if not signing.active:
            wanted = "; the vehicle signs its messages and ignores unsigned ones. Give its key with --sign KEYFILE"
            return wanted if self._vehicle_signs else ""
        if not signing.rejected or signing.believed:
            return ""
        if signing.unsigned == signing.rejected:
            return (
                f"; the vehicle does not sign its messages ({signing.rejected} ignored). Give it the key with"
                " `dronecats preflight --give-key`, or leave --sign out"
            )
        return (
            f"; {signing.rejected} messages are signed with another key, or are older than a minute, and were ignored"
        )

    def give_key(self, key: bytes) -> None:
        """Send the autopilot a key (32 bytes), unencrypted, over this link, and sign from now on.

        Raises LinkError for an armed vehicle, and for a vehicle that does not sign afterwards.
        """
        self.await_heartbeat()  # the vehicle may have been armed while the user read the prompt
        if self.state.armed:
            raise LinkError("an armed vehicle accepts no key. Disarm it first")
        message = dialect.MAVLink_setup_signing_message(
            self.system, self.component, list(key), timestamp(self._unix_s())
        )
        setup = self._packer.pack(message)  # unsigned, because the autopilot has no key yet
        self._sign_with(key)
        for _ in range(KEY_TRIES):
            self.transport.send(setup)
            self._send_heartbeat()
            end_s = self._time_s() + 1.0
            while self._time_s() < end_s:
                self._receive(0.1)
                if self._signing.believed:
                    self._request_streams()
                    return
        raise LinkError(
            f"{self.firmware or 'the autopilot'} does not sign although it got a key. PX4 signs from version 1.17"
            " on, and a vehicle with a key accepts a new key only from its owner"
        )

    # -- time ----------------------------------------------------------------------------------------------------

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock: the time of the newest telemetry plus its known delay."""
        return self.clock.time_us + self.behind_us

    def listen(self) -> None:
        """Process what has already arrived, without waiting."""
        while self._receive(0.0):
            pass

    def await_heartbeat(self) -> None:
        """Process what has already arrived, then wait for a later heartbeat, so that the state is not an old one.

        Raises LinkError if no heartbeat comes within HEARTBEAT_TICKS.
        """
        self.listen()
        known_us = self.state.heartbeat_us
        for _ in range(HEARTBEAT_TICKS):  # not a time, because the vehicle's clock jumps after a pause of our program
            if self.state.heartbeat_us > known_us:
                return
            self.tick()
        raise LinkError(f"the vehicle on {self.transport.url} sends telemetry, but no heartbeat")

    def tick(self) -> None:
        """Wait until a tick of vehicle time has passed, then send what is due. Raises LinkError."""
        if self._tick_due_us < self.time_us - 4 * self.tick_us:  # after a pause of our program
            self._tick_due_us = self.time_us
        self._tick_due_us += self.tick_us
        self._wait_until(self._due)
        self._speak()

    def keep_up(self) -> None:
        """Do the work of `tick` without waiting. Used while the link of another drone waits."""
        self.listen()
        if self._due():
            self._tick_due_us = self.time_us + self.tick_us
            self._speak()

    def _due(self) -> bool:
        # half a tick of tolerance, because telemetry stamps are rounded to milliseconds
        return self.time_us >= self._tick_due_us - self.tick_us // 2

    def _speak(self) -> None:
        """Send the heartbeat and requests if they are due; a subclass sends more."""
        now_s = self._time_s()
        if now_s - self._spoke_s > AWAY_S:
            self.listen()  # after a pause of our program the state is old, so read new messages first
        self._spoke_s = now_s
        if self.time_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = self.time_us + 1_000_000
            self._send_heartbeat()
            for interval in self.streams.check(self.time_us):
                self._request(interval.message_id, interval.interval_us)
            self._request_once()  # again, because an autopilot without a fix has neither origin nor home to send

    def mode_is_known(self) -> bool:
        """Return whether the autopilot has sent its mode since the last gap of telemetry."""
        return self.state.mode_us >= self._gap_us

    def _wait_until(self, reached: Callable[[], bool]) -> None:
        moved_s, moved_us, reads = self._time_s(), self.time_us, 0
        read_s, away_s = moved_s, 0.0
        while not reached():
            received = self._receive(PATIENCE_S)
            if self.clock.reboots != self._boots:
                self._boots, self._heartbeat_due_us, self._tick_due_us = self.clock.reboots, 0, 0
                self._request_streams()
                raise LinkError(f"the autopilot on {self.transport.url} has rebooted")
            self.on_wait()
            reads += 1
            # a read much longer than PATIENCE_S is a pause of our process, not a silence of the vehicle
            now_s, before_s = self._time_s(), read_s
            away_s += now_s - before_s - PATIENCE_S if now_s - before_s > 2.0 * PATIENCE_S else 0.0
            read_s, silent_s = now_s, now_s - moved_s - away_s
            if self.time_us != moved_us:
                if silent_s >= WARNING_S:
                    self.on_silence(silent_s)
                moved_s, moved_us, reads, away_s, self._lost = now_s, self.time_us, 0, 0.0, False
            elif reads >= 5 and silent_s >= (LOST_S if self._lost else self._silence_s):
                self._lost = True  # so the orders at the end of the flight wait only for LOST_S
                fault = "has sent no telemetry" if received else "has been silent"
                raise LinkError(f"the vehicle on {self.transport.url} {fault} for {silent_s:.3g} s")

    def wait(self, seconds: float) -> None:
        """Wait for `seconds` of vehicle time, and continue to send what is due."""
        end_us = self.time_us + round(seconds * 1e6)
        while self.time_us < end_us:
            self.tick()

    def wait_for(self, reached: Callable[[VehicleState], bool], seconds: float, event: str) -> None:
        """Tick until `reached`. Raises LinkError after `seconds`, with `event` and the autopilot's last warning."""
        end_us = self.time_us + round(seconds * 1e6)
        while not reached(self.state):
            if self.time_us >= end_us:
                text = self.texts.last()
                words = f"; the autopilot said: {text}" if text else ""
                raise LinkError(f"{event} did not happen within {seconds:g} s of vehicle time{words}")
            self.tick()

    # -- commands ------------------------------------------------------------------------------------------------

    def _command_long(
        self, command: int, parameters: tuple[float, ...] = (), confirmation: int = 0
    ) -> dialect.MAVLink_message:
        unused = 0.0 if command in ZERO_FILLED else math.nan
        filled = (*parameters, *(unused,) * (7 - len(parameters)))
        return dialect.MAVLink_command_long_message(self.system, self.component, command, confirmation, *filled)

    def command(self, command: int, *parameters: float) -> int:
        """Send a command until it is acknowledged and return its MAV_RESULT. Raises LinkError without an answer."""
        for attempt in range(COMMAND_TRIES):
            self._ack = None
            self.send(self._command_long(command, parameters, attempt))
            end_us = self.time_us + COMMAND_RETRY_US
            while self.time_us < end_us:
                self.tick()
                ack = self._ack
                if ack is not None and ack.command == command and ack.result != dialect.MAV_RESULT_IN_PROGRESS:
                    return int(ack.result)
        raise LinkError(f"the autopilot does not acknowledge command {command}{self._why_unheard()}")

    def order(self, name: str, command: int, *parameters: float, insist_s: float = 0.0) -> None:
        """Send a command. While it is temporarily rejected, send it again for up to `insist_s` (vehicle time).

        Raises LinkError with the autopilot's own words if the command is refused, or still rejected after `insist_s`.
        """
        since_us = self.time_us
        while (result := self.command(command, *parameters)) != dialect.MAV_RESULT_ACCEPTED:
            if result != dialect.MAV_RESULT_TEMPORARILY_REJECTED or self.time_us >= since_us + round(insist_s * 1e6):
                raise LinkError(f"{name} was {self._refusal(result, since_us)}")
            self.wait(AGAIN_S)

    def _refusal(self, result: int, since_us: int) -> str:
        """Return the result of a refused command in words, with the autopilot's texts since `since_us`."""
        self.wait(WORDS_S)
        words = self.texts.since(since_us) or self.texts.last()
        words = f": {words}" if words else ""
        return f"{RESULTS.get(result, f'answered with result {result}')} by the autopilot{words}"
