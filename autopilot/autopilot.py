"""The flight controller around the compiled inner loop: commander, modes, failsafes, parameters and MAVLink ports.

`HANDLERS` maps the type of a received message to its handler. This module has the small handlers: HEARTBEAT, PING,
TIMESYNC, REQUEST_DATA_STREAM and SETUP_SIGNING.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from autopilot.commander.commander import Commander, SetpointWriter
from autopilot.commander.health import SensorCalibration
from autopilot.commander.plans import Plans
from autopilot.estimator.estimated_state import EstimatedState
from autopilot.logging.flight_log import FlightLogWriter, LogDirectory, make_folder
from autopilot.mavlink import commands, file_transfer, mission, steering
from autopilot.mavlink import parameter_protocol as parameter
from autopilot.mavlink.gimbal import GimbalDevice, GimbalManager
from autopilot.mavlink.node import BY_NAME, COMPONENT_ID, GROUPS, Inject, Node, Port
from autopilot.mavlink.status_makers import Message, TelemetrySource
from autopilot.parameters import ParameterTable
from foundation.airframe import Airframe
from foundation.mavlink import dialect

COMMANDER_US = 20_000  # µs between two ticks of the commander (50 Hz)


class Core(Protocol):
    """The interface of the inner loop to the commander (`autopilot.control.flight_core.FlightCore`)."""

    estimate: Any  # ESTIMATE record, which the commander reads
    state: Any  # CONTROL_STATE record; `Autopilot` writes its field `landed`: 1 while on the ground
    setpoint: Any  # SETPOINT record, which the commander writes

    def set_parameter(self, name: str, value: float) -> float | None: ...

    def parameter_defaults(self) -> dict[str, float]: ...


class Autopilot:
    """Flies one vehicle. Call `update` every 10 ms of vehicle time, after the inner loop has run.

    It uses no socket, no thread and no wall clock. Time is `core.estimate.time_us`, or the sensors' time before the
    first estimate. `actuators` (ACTUATORS record, read only) feeds SERVO_OUTPUT_RAW.
    `log_dir` (one per vehicle) receives a ULog file for every flight; without it nothing is logged.
    `card_dir` (one per vehicle) is the memory card, on which clients store files by MAVLink FTP.
    `inject` (unit, type, instance as in MAV_CMD_INJECT_FAILURE) breaks or repairs a part of the simulated vehicle, and
    returns whether this is possible. Without it, failure injection is unsupported.
    `gimbal` carries the camera; without it gimbal commands are unsupported.
    `parameter_file` and `plan_file` store parameters and plans across restarts; a missing file is created when needed.
    Raises UsageError if one of these two files cannot be read, or if `log_dir` or `card_dir` cannot be created.
    """

    def __init__(
        self,
        airframe: Airframe,
        core: Core,
        sensors: Any,
        *,
        system_id: int = 1,
        parameter_file: Path | None = None,
        plan_file: Path | None = None,
        log_dir: Path | None = None,
        card_dir: Path | None = None,
        actuators: Any | None = None,
        inject: Inject | None = None,
        gimbal: GimbalDevice | None = None,
    ) -> None:
        self._core = core
        self._core_landed: bool | None = None
        self._commanded_us = -COMMANDER_US
        self.parameters = ParameterTable(core.parameter_defaults(), core.set_parameter, parameter_file)
        self.parameters.set("MAV_SYS_ID", system_id)
        self.parameters.set("MAV_TYPE", airframe.mav_type)
        self.state = EstimatedState(core.estimate, sensors)
        self.commander = Commander(self.state, self.parameters, SetpointWriter(core.setpoint), self._send_text)
        self._keep_plans(Plans(plan_file))
        self.calibration = SensorCalibration(self.state, self._send_text)
        vehicle = TelemetrySource(
            airframe, self.state, self.commander, self.parameters, actuators, self.calibration,
            GimbalManager(gimbal) if gimbal else None,
        )  # fmt: skip
        self._log_failure: str | None = None
        self.log = FlightLogWriter(vehicle, LogDirectory(log_dir)) if log_dir is not None else None
        if card_dir is not None:
            make_folder(card_dir)
        self.node = Node(vehicle, system_id, self.log, inject, card_dir)

    def update(self) -> None:
        """Run the commander if it is due (50 Hz), and queue the telemetry that is due on every port."""
        state, node = self.state, self.node
        state.refresh()
        self.calibration.tick()
        now = state.time_us
        if not 0 <= now - self._commanded_us < COMMANDER_US:
            self._commanded_us = now
            self.commander.tick()
            self._update_core()
        if self.log is not None:
            self.log.tick()
            self._report_log_failure(self.log.failed)
        node.send_mode_changes()
        if self.commander.mission.reached:
            mission.tell_progress(node)
        node.uploads.tick(now)
        for port in node.ports:
            port.tick(now)

    def _report_log_failure(self, reason: str | None) -> None:
        """Send a warning when the flight log fails, once per failure."""
        if reason is not None and reason != self._log_failure:
            self._send_text(dialect.MAV_SEVERITY_WARNING, f"Flight log not written: {reason}")
        self._log_failure = reason

    def stream(self) -> None:
        """Queue the telemetry that is due between two updates. Call it every `stream_us` if that is below 10 ms."""
        self.state.refresh()
        for port in self.node.ports:
            port.stream(self.state.time_us)

    @property
    def stream_us(self) -> int:
        """The interval (µs) of the fastest stream of all ports. If it is below 10 ms, call `stream` too."""
        return self.node.shortest_us

    def close(self) -> None:
        """End the open flight log, if any."""
        if self.log is not None:
            self.log.close()

    def open_port(self, profile: str) -> Port:
        """Return a new port with the streams of 'onboard' (PX4's 14540), 'gcs' (14550) or 'minimal' (only HEARTBEAT).

        Raises UsageError for another profile.
        """
        port = Port(self.node, profile, len(self.node.ports), partial(handle, self.node))
        self.node.ports.append(port)
        self.node.find_shortest()
        return port

    def close_port(self, port: Port) -> None:
        """Remove a port. Raises ValueError if the port is not open."""
        self.node.ports.remove(port)
        self.node.find_shortest()

    @property
    def reboot_requested(self) -> bool:
        """True if a client has requested a restart. The owner of this object may then replace it by a new one."""
        return self.node.reboot_requested

    def adopt(self, former: "Autopilot") -> None:
        """Copy from `former` what survives a restart: parameters, plans, and the number of the next mission item."""
        for name in former.parameters.names:
            self.parameters.set(name, former.parameters[name])
        self._keep_plans(former.commander.flight.plans)

    def _keep_plans(self, plans: Plans) -> None:
        self.commander.flight.plans = plans
        if plans.current:
            self.commander.mission.rewind(plans.current)

    def _update_core(self) -> None:
        landed = self.commander.landed
        if landed != self._core_landed:
            self._core.state["landed"] = self._core_landed = landed

    def _send_text(self, severity: int, text: str) -> None:
        self.node.send_text(severity, text)


def _as_mavlink2(frame: bytes, crc_extra: int) -> bytes:
    """Return a packed message as MAVLink 2. Older clients begin with MAVLink 1, but our links carry only MAVLink 2."""
    if frame[0] != dialect.PROTOCOL_MARKER_V1:
        return frame
    length, sequence, system, component, number = frame[1:6]
    body = bytes((length, 0, 0, sequence, system, component, number, 0, 0)) + frame[6 : 6 + length]
    crc: int = dialect.x25crc(body + bytes((crc_extra,))).crc
    return bytes((dialect.PROTOCOL_MARKER_V2,)) + body + crc.to_bytes(2, "little")


def heartbeat(node: Node, port: Port, message: Message) -> None:
    """Store the time of a ground station's heartbeat. Forward the heartbeats of other systems to the other ports."""
    if message.get_srcSystem() != node.system_id:
        node.forward(port, _as_mavlink2(bytes(message.get_msgbuf()), message.crc_extra))
    if message.type == dialect.MAV_TYPE_GCS:
        node.vehicle.commander.supervision.station_seen_us = node.time_us


def ping(node: Node, port: Port, message: Message) -> None:
    """Reply to a request (target 0/0) with the time and sequence number of the request."""
    if message.target_system == 0 and message.target_component == 0:
        port.send(
            dialect.MAVLink_ping_message(
                message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()
            )
        )


def timesync(node: Node, port: Port, message: Message) -> None:
    """Reply to a request (tc1 = 0) with the vehicle's time in ns."""
    if message.tc1 == 0:
        port.send(dialect.MAVLink_timesync_message(node.time_us * 1000, message.ts1))


def request_data_stream(node: Node, port: Port, message: Message) -> None:
    """Raise the rates of a group of streams; a rate that is already higher stays. A stop request restores defaults."""
    for name in GROUPS.get(message.req_stream_id, ()):
        message_id = BY_NAME[name].message_id
        if not message.start_stop:
            port.set_default_interval(message_id)
        elif message.req_message_rate > 0:
            wanted, present = 1_000_000 // message.req_message_rate, port.interval_us(message_id)
            if present < 0 or wanted < present:
                port.set_interval(message_id, wanted)


def setup_signing(node: Node, port: Port, message: Message) -> None:
    """Set the key of SETUP_SIGNING on every port, as PX4 does. A message for another vehicle is ignored.

    The message is not forwarded. An armed vehicle refuses the key, because a new key would lock out the client that
    flies it.
    """
    if message.target_system != node.system_id:
        return
    if node.vehicle.commander.armed:
        node.complain("Signing key refused: vehicle is armed")
        return
    for other_port in node.ports:
        other_port.signing.set_up(bytes(message.secret_key), message.initial_timestamp, node.time_us)


MessageHandler = Callable[[Node, Port, Message], None]

HANDLERS: dict[str, MessageHandler] = {
    "HEARTBEAT": heartbeat,
    "PING": ping,
    "TIMESYNC": timesync,
    "REQUEST_DATA_STREAM": request_data_stream,
    "COMMAND_LONG": commands.command_long,
    "COMMAND_INT": commands.command_int,
    "SET_MODE": commands.set_mode_message,
    "SET_POSITION_TARGET_LOCAL_NED": steering.local_ned,
    "SET_POSITION_TARGET_GLOBAL_INT": steering.global_int,
    "SET_ATTITUDE_TARGET": steering.attitude_target,
    "FOLLOW_TARGET": steering.follow_target,
    "MANUAL_CONTROL": steering.manual_control,
    "PARAM_REQUEST_LIST": parameter.request_list,
    "PARAM_REQUEST_READ": parameter.request_read,
    "PARAM_SET": parameter.set_value,
    "MISSION_REQUEST_LIST": mission.request_list,
    "MISSION_REQUEST": mission.request_item,
    "MISSION_REQUEST_INT": mission.request_item,
    "MISSION_COUNT": mission.count,
    "MISSION_WRITE_PARTIAL_LIST": mission.refuse,
    "MISSION_ITEM": mission.take_item,
    "MISSION_ITEM_INT": mission.take_item,
    "MISSION_ACK": mission.acknowledged,
    "MISSION_CLEAR_ALL": mission.clear_all,
    "MISSION_SET_CURRENT": mission.set_current,
    "FILE_TRANSFER_PROTOCOL": file_transfer.request,
    "SETUP_SIGNING": setup_signing,
    "LOG_REQUEST_LIST": file_transfer.request_list,
    "LOG_REQUEST_DATA": file_transfer.request_data,
    "LOG_REQUEST_END": file_transfer.request_end,
    "LOG_ERASE": file_transfer.erase,
}
_COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})  # if sent to another target, the answer is FAILED


def handle(node: Node, port: Port, message: Message) -> None:
    """Call the handler of a message. Messages from this component are ignored.

    Messages for other targets are ignored too, except commands, which get the answer FAILED. An error of the handler is
    counted, not raised. The first error is also sent to the clients as a text.
    """
    kind = message.get_type()
    handler = HANDLERS.get(kind)
    if handler is None or (message.get_srcSystem() == node.system_id and message.get_srcComponent() == COMPONENT_ID):
        return
    if kind not in _COMMANDS and not _for_us(node, message):
        return
    try:
        handler(node, port, message)
    except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as error:
        node.handler_errors += 1
        if node.handler_errors == 1:
            node.send_text(4, f"{kind} could not be handled: {type(error).__name__}")


def _for_us(node: Node, message: Message) -> bool:
    system = getattr(message, "target_system", 0)
    component = getattr(message, "target_component", 0)
    return system in (0, node.system_id) and component in (0, COMPONENT_ID)
