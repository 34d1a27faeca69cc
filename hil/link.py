"""The link to any MAVLink autopilot, ours or PX4: one class through which every flight goes."""

import math
import time
from collections.abc import Callable

from dronecats.border.errors import LinkError
from dronecats.border.frames import Vec3, wrap_pi
from dronecats.border.mavlink import MODES, Packer, Parser, dialect
from dronecats.border.setpoints import Setpoint
from hil.offboard import OffboardStream, position_target
from hil.telemetry import TOLD, VehicleClock, VehicleState, update
from hil.transport import Transport

SYSTEM, COMPONENT = 245, 191  # MAV_COMP_ID_ONBOARD_COMPUTER; a ground station keeps 255/190
TICK_US = 50_000  # 20 Hz of vehicle time
SILENCE_S = 5.0  # wall seconds without a byte after which the vehicle is gone
COMMAND_RETRY_US = 500_000
COMMAND_TRIES = 6
WATCHED = {  # message id -> µs between two
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: TICK_US,
    dialect.MAVLINK_MSG_ID_ATTITUDE: TICK_US,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 200_000,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: 500_000,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: 1_000_000,
    dialect.MAVLINK_MSG_ID_CURRENT_MODE: 100_000,
}
AUTOPILOT = dialect.MAV_COMP_ID_AUTOPILOT1
HEARTBEAT, COMMAND_ACK = dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_COMMAND_ACK
STAMPED = {dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAVLINK_MSG_ID_ATTITUDE}  # either keeps the clock going
HEARD = TOLD | {COMMAND_ACK}  # most of what an autopilot streams is for others
RESULTS = {
    1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 5: "in progress", 6: "cancelled",
}  # fmt: skip


class Link:
    """Telemetry in, commands and setpoints out, on the vehicle's clock. The clock moves only inside this class."""

    def __init__(self, transport: Transport, *, silence_s: float = SILENCE_S) -> None:
        self.transport = transport
        self.state = VehicleState()
        self.clock = VehicleClock()
        self.system = 0
        self.component = dialect.MAV_COMP_ID_AUTOPILOT1
        self.listeners: list[Callable[[dialect.MAVLink_message], None]] = []  # hear every message of the wire
        self.on_wait: Callable[[], None] = lambda: None  # called while waiting; may raise to break the wait off
        self._silence_s = silence_s
        self._parser = Parser()
        self._packer = Packer(SYSTEM, COMPONENT)
        self._stream = OffboardStream()
        self._heartbeat_due_us = 0
        self._tick_due_us = 0
        self._tried_to_arm = False
        self._ack: dialect.MAVLink_message | None = None
        self._telemetry_ms = -1

    # -- the wire ------------------------------------------------------------------------------------------------

    def connect(self, timeout_s: float = 30.0) -> None:
        """Wait for the autopilot's heartbeat and telemetry, and ask for the streams that flying needs.

        Raises LinkError when no autopilot is heard within `timeout_s` wall seconds.
        """
        waited_s, patience_s, asked_s = 0.0, 0.5, -math.inf
        while not self.system or self.state.position_ned is None or self.state.euler is None:
            if waited_s >= asked_s + 1.0:  # not more often: each request starts the interval anew
                asked_s = waited_s
                self._send_heartbeat()
                if self.system:
                    self._request_streams()
            # bytes that are not what is waited for come at the autopilot's rate, about a hundred times a second
            waited_s += 0.01 if self._receive(patience_s) else patience_s
            self.on_wait()
            if waited_s >= timeout_s:
                what = "no telemetry" if self.system else "no MAVLink heartbeat of an autopilot"
                raise LinkError(f"{what} on {self.transport.url} within {timeout_s:g} s")
        self._request_streams()

    def send(self, message: dialect.MAVLink_message) -> None:
        self.transport.send(self._packer.pack(message))

    def close(self) -> None:
        self.transport.close()

    def _receive(self, timeout_s: float) -> bool:
        data = self.transport.receive(timeout_s)
        for message in self._parser.feed(data):
            self._take(message)
        return bool(data)

    def _take(self, message: dialect.MAVLink_message) -> None:
        for listener in self.listeners:
            listener(message)
        kind = message.get_msgId()
        if kind not in HEARD or message.get_srcComponent() != AUTOPILOT:
            return
        if kind == HEARTBEAT and not self.system:
            self.system = message.get_srcSystem()
        if message.get_srcSystem() != self.system:
            return
        if kind == COMMAND_ACK:
            if message.target_system in (0, SYSTEM) and message.target_component in (0, COMPONENT):
                self._ack = message
            return
        if kind in STAMPED:
            self.clock.see(message.time_boot_ms)
        self.state = update(self.state, message)

    def _request_streams(self) -> None:
        for message_id, interval_us in WATCHED.items():
            self.send(self._command_long(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, (message_id, interval_us)))
        self.send(self._command_long(dialect.MAV_CMD_REQUEST_MESSAGE, (dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,)))

    def _send_heartbeat(self) -> None:
        self.send(
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
            )
        )

    # -- time ----------------------------------------------------------------------------------------------------

    @property
    def time_us(self) -> int:
        """µs, the vehicle's clock at its newest telemetry."""
        return self.clock.time_us

    def listen(self) -> None:
        """Take in what has already arrived, without waiting."""
        while self._receive(0.0):
            pass

    def tick(self) -> None:
        """Wait until a tick of vehicle time has passed, then send what is being streamed. Raises LinkError."""
        if self._tick_due_us < self.time_us - 4 * TICK_US:  # we were away, for instance drawing a frame
            self._tick_due_us = self.time_us
        self._tick_due_us += TICK_US
        self._wait_until(self._due)
        self._speak()

    def keep_up(self) -> None:
        """Take in what has arrived and send what is due, without waiting: for a link whose turn it is not."""
        self.listen()
        if self._due():
            self._tick_due_us = self.time_us + TICK_US
            self._speak()

    def _due(self) -> bool:
        # half a tick of grace: a stream of exactly 20 Hz must not be missed by a rounded millisecond
        return self.time_us >= self._tick_due_us - TICK_US // 2

    def _speak(self) -> None:
        """Send the heartbeat when it is due, and what is being streamed."""
        if self.time_us >= self._heartbeat_due_us:
            self._heartbeat_due_us = self.time_us + 1_000_000
            self._send_heartbeat()
        setpoint = self._setpoint_message()
        if setpoint is not None:
            self.send(setpoint)

    def _setpoint_message(self) -> dialect.MAVLink_message | None:
        state = self.state
        if state.position_ned is None or state.velocity_ned is None or state.euler is None:
            return None
        return self._stream.message(
            state.position_ned, state.velocity_ned, state.euler[2], self.time_us // 1000, self.system, self.component
        )

    def _wait_until(self, reached: Callable[[], bool]) -> None:
        patience_s, moved_s, moved_us, reads = 0.5, time.monotonic(), self.time_us, 0
        while not reached():
            heard = self._receive(patience_s)
            self.on_wait()
            reads += 1
            if self.time_us != moved_us:
                moved_s, moved_us, reads = time.monotonic(), self.time_us, 0
            # wall time is the subject here; several reads, so that one long pause of our own is not held against it
            elif reads >= 5 and time.monotonic() - moved_s >= self._silence_s:
                what = "sends no telemetry any more" if heard else "has been silent"
                raise LinkError(f"the vehicle on {self.transport.url} {what} for {self._silence_s:g} s")

    def wait(self, seconds: float) -> None:
        """Let vehicle time pass, streaming on."""
        end_us = self.time_us + round(seconds * 1e6)
        while self.time_us < end_us:
            self.tick()

    def wait_for(self, reached: Callable[[VehicleState], bool], seconds: float, what: str) -> None:
        """Tick until `reached`. Raises LinkError naming `what` and the autopilot's last warning after `seconds`."""
        end_us = self.time_us + round(seconds * 1e6)
        while not reached(self.state):
            if self.time_us >= end_us:
                said = f"; the autopilot said: {self.state.status_text}" if self.state.status_text else ""
                raise LinkError(f"{what} did not happen within {seconds:g} s of vehicle time{said}")
            self.tick()

    # -- commands ------------------------------------------------------------------------------------------------

    def _command_long(
        self, command: int, parameters: tuple[float, ...] = (), confirmation: int = 0
    ) -> dialect.MAVLink_message:
        filled = (*parameters, *(math.nan,) * (7 - len(parameters)))
        # a message interval's unused parameters are zero by the standard, all others may be NaN: "use the default"
        if command in (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_CMD_REQUEST_MESSAGE):
            filled = (*parameters, *(0.0,) * (7 - len(parameters)))
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
        raise LinkError(f"the autopilot does not acknowledge command {command}")

    def order(self, what: str, command: int, *parameters: float) -> None:
        """Send a command that has to be accepted. Raises LinkError with the autopilot's own words when refused."""
        result = self.command(command, *parameters)
        if result != dialect.MAV_RESULT_ACCEPTED:
            raise LinkError(f"{what} was {self._refusal(result)}")

    def _refusal(self, result: int) -> str:
        said = f": {self.state.status_text}" if self.state.status_text else ""
        return f"{RESULTS.get(result, f'answered with result {result}')} by the autopilot{said}"

    def set_mode(self, name: str) -> None:
        """Switch the flight mode. Raises LinkError when refused."""
        mode = MODES[name]
        self.order(f"mode {name}", dialect.MAV_CMD_DO_SET_MODE, 1, mode.main, mode.sub)

    def arm(self) -> None:
        """Arm; retried for ten seconds, since a pre-arm check may flicker. Raises LinkError when refused to the end."""
        self._tried_to_arm = True
        end_us = self.time_us + 10_000_000
        while (result := self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)) != dialect.MAV_RESULT_ACCEPTED:
            if result != dialect.MAV_RESULT_TEMPORARILY_REJECTED or self.time_us >= end_us:
                raise LinkError(f"arming was {self._refusal(result)}")
            self.wait(0.5)
        self.wait_for(lambda state: state.armed, 5.0, "arming")

    def may_fly(self) -> bool:
        """Return whether the vehicle may be in the air by our doing, or stand there armed: ground it then.

        Heartbeats lag by up to a second, so one that we have just told to arm is asked: it disarms on the ground and
        refuses to in the air.
        """
        if self.state.armed or not self._tried_to_arm:
            return self.state.armed
        return bool(self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0) != dialect.MAV_RESULT_ACCEPTED)

    # -- flight --------------------------------------------------------------------------------------------------

    def fly(self, setpoint: Setpoint) -> None:
        """From the next tick on, stream this setpoint."""
        self._stream.fly(setpoint)

    def start_offboard(self) -> None:
        """Enter offboard with the setpoint given to `fly`. Raises LinkError when refused."""
        self.tick()
        self.set_mode("OFFBOARD")
        self.wait_for(lambda state: state.mode == "OFFBOARD", 3.0, "offboard mode")

    def stop_stream(self) -> None:
        """Send no setpoint from now on; the autopilot's own failsafe is what follows unless a mode is set."""
        self._stream.stop()

    def stop_offboard(self) -> None:
        """Stop streaming and let the autopilot hold."""
        self._stream.stop()
        self.set_mode("HOLD")

    def go_to(self, position_ned: Vec3, yaw: float, *, tolerance_m: float = 0.25, seconds: float = 60.0) -> None:
        """Fly to a place of the local frame in offboard and settle there. Raises LinkError after `seconds`.

        Settled: within `tolerance_m` and 3° at less than 0.15 m/s for a whole second.
        """
        self._stream.stop()
        end_us, settled_us = self.time_us + round(seconds * 1e6), None
        while settled_us is None or self.time_us < settled_us + 1_000_000:
            if self.time_us >= end_us:
                raise LinkError(f"the vehicle did not settle at its start pose within {seconds:g} s of vehicle time")
            self.send(position_target(position_ned, yaw, self.time_us // 1000, self.system, self.component))
            self.tick()
            if self.state.mode != "OFFBOARD" and self.time_us > end_us - round(seconds * 1e6) + 100_000:
                self.set_mode("OFFBOARD")
            settled = self._is_at(position_ned, yaw, tolerance_m)
            settled_us = (settled_us or self.time_us) if settled else None

    def _is_at(self, position_ned: Vec3, yaw: float, tolerance_m: float) -> bool:
        state = self.state
        if state.position_ned is None or state.velocity_ned is None or state.euler is None:
            return False
        return (
            math.dist(state.position_ned, position_ned) <= tolerance_m
            and math.hypot(*state.velocity_ned) <= 0.15
            and abs(wrap_pi(state.euler[2] - yaw)) <= math.radians(3.0)
        )
