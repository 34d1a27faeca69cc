"""One table: the type of a received message → the service that handles it.

The small services that keep a link alive are here: heartbeats of others, PING, TIMESYNC, old stream requests, the key.
"""

from collections.abc import Callable

from autopilot.mavlink import commands, file_transfer, mission, steering
from autopilot.mavlink import parameter_protocol as parameter
from autopilot.mavlink.node import Node
from autopilot.mavlink.port import BY_NAME, COMPONENT_ID, GROUPS, Port
from autopilot.mavlink.status_makers import Message
from foundation.mavlink import dialect


def _as_mavlink2(frame: bytes, crc_extra: int) -> bytes:
    """Return a packed message in MAVLink 2, which is all that our links carry; older clients begin with MAVLink 1."""
    if frame[0] != dialect.PROTOCOL_MARKER_V1:
        return frame
    length, sequence, system, component, number = frame[1:6]
    body = bytes((length, 0, 0, sequence, system, component, number, 0, 0)) + frame[6 : 6 + length]
    crc: int = dialect.x25crc(body + bytes((crc_extra,))).crc
    return bytes((dialect.PROTOCOL_MARKER_V2,)) + body + crc.to_bytes(2, "little")


def heartbeat(node: Node, port: Port, message: Message) -> None:
    """Remember when a ground station was last heard, and let the other links know of the sender."""
    if message.get_srcSystem() != node.system_id:
        node.forward(port, _as_mavlink2(bytes(message.get_msgbuf()), message.crc_extra))
    if message.type == dialect.MAV_TYPE_GCS:
        node.vehicle.commander.supervision.station_seen_us = node.time_us


def ping(node: Node, port: Port, message: Message) -> None:
    """Answer a request (target 0/0) with its own time and number, addressed to the sender."""
    if message.target_system == 0 and message.target_component == 0:
        port.send(
            dialect.MAVLink_ping_message(
                message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()
            )
        )


def timesync(node: Node, port: Port, message: Message) -> None:
    """Answer a request (tc1 = 0) with the vehicle's time in ns."""
    if message.tc1 == 0:
        port.send(dialect.MAVLink_timesync_message(node.time_us * 1000, message.ts1))


def request_data_stream(node: Node, port: Port, message: Message) -> None:
    """Raise the rates of a group of streams, never below what the port already sends; stop = back to the default."""
    for name in GROUPS.get(message.req_stream_id, ()):
        message_id = BY_NAME[name].message_id
        if not message.start_stop:
            port.set_default_interval(message_id)
        elif message.req_message_rate > 0:
            wanted, present = 1_000_000 // message.req_message_rate, port.interval_us(message_id)
            if present < 0 or wanted < present:
                port.set_interval(message_id, wanted)


def setup_signing(node: Node, port: Port, message: Message) -> None:
    """Take the key of SETUP_SIGNING for every port, as PX4 does. It never goes further; only the addressed take it.

    An armed vehicle takes none: its agent must not be shut out in flight.
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
_COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})  # answer even when meant for somebody else


def handle(node: Node, port: Port, message: Message) -> None:
    """Let the right service act. A message that breaks it is counted and said once, never raised."""
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
