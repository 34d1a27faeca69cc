"""One table: the type of a received message → the service that handles it."""

from collections.abc import Callable

from autopilot.mavlink import (
    commands,
    file_transfer,
    follow_target,
    link,
    logs,
    manual_control,
    mission,
    offboard_setpoints,
)
from autopilot.mavlink import parameter_protocol as parameter
from autopilot.mavlink.node import Node
from autopilot.mavlink.port import COMPONENT_ID, Port
from autopilot.mavlink.telemetry_source import Message

MessageHandler = Callable[[Node, Port, Message], None]

HANDLERS: dict[str, MessageHandler] = {
    "HEARTBEAT": link.heartbeat,
    "PING": link.ping,
    "TIMESYNC": link.timesync,
    "REQUEST_DATA_STREAM": link.request_data_stream,
    "COMMAND_LONG": commands.command_long,
    "COMMAND_INT": commands.command_int,
    "SET_MODE": commands.set_mode_message,
    "SET_POSITION_TARGET_LOCAL_NED": offboard_setpoints.local_ned,
    "SET_POSITION_TARGET_GLOBAL_INT": offboard_setpoints.global_int,
    "SET_ATTITUDE_TARGET": offboard_setpoints.attitude_target,
    "FOLLOW_TARGET": follow_target.follow_target,
    "MANUAL_CONTROL": manual_control.manual_control,
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
    "SETUP_SIGNING": link.setup_signing,
    "LOG_REQUEST_LIST": logs.request_list,
    "LOG_REQUEST_DATA": logs.request_data,
    "LOG_REQUEST_END": logs.request_end,
    "LOG_ERASE": logs.erase,
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
            node.say(4, f"{kind} could not be handled: {type(error).__name__}")


def _for_us(node: Node, message: Message) -> bool:
    system = getattr(message, "target_system", 0)
    component = getattr(message, "target_component", 0)
    return system in (0, node.system_id) and component in (0, COMPONENT_ID)
