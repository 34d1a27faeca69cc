"""Missions, geofences and rally points: the place for the transfer protocol. Holds nothing yet, and answers at once."""

from typing import TYPE_CHECKING

from autopilot.mavlink.node import Node
from autopilot.mavlink.streams import BY_NAME
from autopilot.mavlink.vehicle import Message
from dronecats.border.mavlink import dialect

if TYPE_CHECKING:
    from autopilot.mavlink.port import Port


def _acknowledge(port: "Port", message: Message, result: int) -> None:
    port.send(
        dialect.MAVLink_mission_ack_message(
            message.get_srcSystem(), message.get_srcComponent(), result, getattr(message, "mission_type", 0)
        )
    )


def request_list(node: Node, port: "Port", message: Message) -> None:
    """Answer how many items there are: none."""
    port.send(
        dialect.MAVLink_mission_count_message(
            message.get_srcSystem(), message.get_srcComponent(), 0, message.mission_type
        )
    )


def request_item(node: Node, port: "Port", message: Message) -> None:
    """There is no such item."""
    _acknowledge(port, message, dialect.MAV_MISSION_INVALID_SEQUENCE)


def count(node: Node, port: "Port", message: Message) -> None:
    """Accept an empty upload (that clears), refuse every other."""
    _acknowledge(port, message, dialect.MAV_MISSION_UNSUPPORTED if message.count else dialect.MAV_MISSION_ACCEPTED)


def refuse(node: Node, port: "Port", message: Message) -> None:
    """Refuse a write."""
    _acknowledge(port, message, dialect.MAV_MISSION_UNSUPPORTED)


def clear_all(node: Node, port: "Port", message: Message) -> None:
    """Nothing is left."""
    _acknowledge(port, message, dialect.MAV_MISSION_ACCEPTED)


def set_current(node: Node, port: "Port", message: Message) -> None:
    """Answer with the item in force."""
    port.send_telemetry(BY_NAME["MISSION_CURRENT"].message_id)
