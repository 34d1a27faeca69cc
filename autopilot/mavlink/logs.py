"""On-board log download: the place for it. There is no log on board yet."""

from typing import TYPE_CHECKING

from autopilot.mavlink.node import Node
from autopilot.mavlink.vehicle import Message
from dronecats.border.mavlink import dialect

if TYPE_CHECKING:
    from autopilot.mavlink.port import Port


def request_list(node: Node, port: "Port", message: Message) -> None:
    """Answer that there are no logs."""
    port.send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))


def request_data(node: Node, port: "Port", message: Message) -> None:
    """Answer with the end of an empty log."""
    port.send(dialect.MAVLink_log_data_message(message.id, message.ofs, 0, [0] * 90))
