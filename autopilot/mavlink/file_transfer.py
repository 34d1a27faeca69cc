"""MAVLink FTP: the place for it. There is no file yet, and every request is answered at once so that nobody waits."""

import struct
from typing import TYPE_CHECKING

from autopilot.mavlink.node import Node
from autopilot.mavlink.vehicle import Message
from dronecats.border.mavlink import dialect

if TYPE_CHECKING:
    from autopilot.mavlink.port import Port

ACK, NAK = 128, 129
TERMINATE_SESSION, RESET_SESSIONS = 1, 2
LAST_OPCODE = 15  # BurstReadFile
UNKNOWN_COMMAND, FILE_NOT_FOUND = 7, 10
_HEADER = struct.Struct("<HBBBBBBI")  # seq, session, opcode, size, requested opcode, burst complete, padding, offset
PAYLOAD = 251


def request(node: Node, port: "Port", message: Message) -> None:
    """Answer one request of the protocol (mavlink.io, services/ftp)."""
    sequence, session, opcode, *_ = _HEADER.unpack_from(bytes(message.payload))
    if opcode in (ACK, NAK):
        return
    if opcode in (TERMINATE_SESSION, RESET_SESSIONS):
        answer, data = ACK, b""
    else:
        answer, data = NAK, bytes([FILE_NOT_FOUND if 0 < opcode <= LAST_OPCODE else UNKNOWN_COMMAND])
    head = _HEADER.pack((sequence + 1) & 0xFFFF, session, answer, len(data), opcode, 0, 0, 0)
    payload = (head + data).ljust(PAYLOAD, b"\0")
    port.send(
        dialect.MAVLink_file_transfer_protocol_message(
            0, message.get_srcSystem(), message.get_srcComponent(), list(payload)
        )
    )
