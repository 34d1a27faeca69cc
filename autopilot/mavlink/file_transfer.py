"""Files over MAVLink: the server side of MAVLink FTP, and the download of the flight logs.

The server replies to every FTP request at once: an ACK with the data, or a NAK with the reason. Source: mavlink.io,
services/ftp. A repeated request gets the same reply and is not executed again. LOG_REQUEST_LIST, _DATA, _END and
LOG_ERASE send and erase flight logs, which are numbered from 0, as in PX4.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from autopilot.logging.flight_log import LogFile
from autopilot.mavlink.file_tree import (
    END_OF_FILE,
    FAIL,
    FAIL_ERRNO,
    FILE_EXISTS,
    FILE_NOT_FOUND,
    FILE_PROTECTED,
    INVALID_DATA_SIZE,
    LARGEST,
    UNKNOWN_COMMAND,
    Client,
    Entry,
    FileSessions,
    FileTree,
    Refusal,
)
from autopilot.mavlink.node import Node, Port, sender
from autopilot.mavlink.status_makers import Message
from foundation.mavlink import dialect

ACK, NAK = 128, 129
NONE, TERMINATE_SESSION, RESET_SESSIONS, LIST_DIRECTORY, OPEN_TO_READ, READ, CREATE, WRITE = range(8)
REMOVE_FILE, MAKE_FOLDER, REMOVE_FOLDER, OPEN_TO_WRITE, TRUNCATE, RENAME, CHECKSUM, BURST_READ = range(8, 16)
LIST_DIRECTORY_WITH_TIME = 16
OPENING = frozenset({OPEN_TO_READ, CREATE, OPEN_TO_WRITE})

_HEADER = struct.Struct("<HBBBBBBI")  # seq, session, opcode, size, requested opcode, burst complete, padding, offset
PAYLOAD = 251
DATA = PAYLOAD - _HEADER.size  # 239 bytes
BURST_MESSAGES = 200  # limit of one burst (48 kB); then the client requests the next burst


@dataclass(frozen=True, slots=True)
class FileRequest:
    """The fields of a received request."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def name(self) -> bytes:
        """The first name in the data, without the zero that may end it."""
        return self.data.partition(b"\0")[0]


def parsed(payload: bytes) -> FileRequest:
    """Return the request in FILE_TRANSFER_PROTOCOL.payload (251 bytes)."""
    sequence, session, opcode, size, _, _, _, offset = _HEADER.unpack_from(payload)
    return FileRequest(sequence, session, opcode, size, offset, payload[_HEADER.size : _HEADER.size + size])


@dataclass(slots=True)
class Server:
    """The context of one request: the files, the sessions, and the client."""

    tree: FileTree
    sessions: FileSessions
    client: Client
    now_us: int
    opened: int | None = None  # the session that this request has opened


def request(node: Node, port: Port, message: Message) -> None:
    """Reply to one request, or start a burst."""
    payload = bytes(message.payload)
    wish = parsed(payload)
    if wish.opcode in (ACK, NAK):  # an answer for another client
        return
    address = sender(message)
    server = Server(node.files, node.file_sessions, (port, *address), node.time_us)
    if wish.opcode == BURST_READ:
        _begin_burst(server, port, address, wish)
        return
    if wish.opcode in (TERMINATE_SESSION, RESET_SESSIONS):
        port.transfers.pop(_burst_name(address), None)
    answer = server.sessions.answered(server.client, payload)
    if answer is None:
        answer = _answer(server, wish)
        server.sessions.remember(server.client, payload, answer)
    port.send(_message(address, answer))


def _message(address: tuple[int, int], payload: bytes) -> Message:
    return dialect.MAVLink_file_transfer_protocol_message(0, *address, list(payload.ljust(PAYLOAD, b"\0")))


def _pack(wish: FileRequest, opcode: int, data: bytes, *, session: int | None = None, complete: bool = False,
          later: int = 0, offset: int | None = None) -> bytes:  # fmt: skip
    return (
        _HEADER.pack(
            (wish.sequence + 1 + later) & 0xFFFF, wish.session if session is None else session, opcode, len(data),
            wish.opcode, complete, 0, wish.offset if offset is None else offset,
        )
        + data
    )  # fmt: skip


def _answer(server: Server, wish: FileRequest) -> bytes:
    """Execute a request; return the payload of the reply, a NAK for any error."""
    try:
        if wish.size > DATA:
            raise Refusal(INVALID_DATA_SIZE)
        handler = HANDLERS.get(wish.opcode)
        if handler is None:
            raise Refusal(UNKNOWN_COMMAND)
        if wish.opcode in OPENING:
            server.sessions.make_room(server.now_us)
        data = handler(server, wish) or b""
    except (Refusal, OSError, ValueError) as reason:
        return _pack(wish, NAK, _refusal(reason))
    return _pack(wish, ACK, data, session=server.opened)


def _refusal(reason: Exception) -> bytes:
    """Return the data of a NAK."""
    if isinstance(reason, Refusal):
        return reason.data
    if isinstance(reason, FileNotFoundError | NotADirectoryError):
        return bytes([FILE_NOT_FOUND])
    if isinstance(reason, FileExistsError):
        return bytes([FILE_EXISTS])
    if isinstance(reason, PermissionError):
        return bytes([FILE_PROTECTED])
    if isinstance(reason, OSError) and reason.errno:
        return bytes([FAIL_ERRNO, reason.errno & 0xFF])
    return bytes([FAIL])


def _open(server: Server, wish: FileRequest, file: BinaryIO, writable: bool) -> None:
    server.opened = server.sessions.open(server.client, wish.session, file, writable, server.now_us)


def _open_to_read(server: Server, wish: FileRequest) -> bytes:
    file, size = server.tree.open_to_read(wish.name)
    _open(server, wish, file, writable=False)
    return struct.pack("<I", min(size, 0xFFFFFFFF))


def _open_to_write(server: Server, wish: FileRequest) -> None:
    file = server.tree.open_to_write(wish.name, empty=wish.opcode == CREATE)
    _open(server, wish, file, writable=True)


def _read(server: Server, wish: FileRequest) -> bytes:
    file = server.sessions.get(server.client, wish.session, server.now_us).file
    if not file.readable():
        raise Refusal(FAIL)
    file.seek(wish.offset)
    data = file.read(wish.size)
    if not data:
        raise Refusal(END_OF_FILE if wish.size else INVALID_DATA_SIZE)
    return data


def _write(server: Server, wish: FileRequest) -> None:
    session = server.sessions.get(server.client, wish.session, server.now_us)
    if not session.writable or wish.offset + wish.size > LARGEST:
        raise Refusal(FAIL)
    session.file.seek(wish.offset)
    session.file.write(wish.data)
    session.file.flush()


def _list(server: Server, wish: FileRequest) -> bytes:
    """Return as many lines of the directory as fit, from line number `offset` on."""
    lines = b""
    for entry in server.tree.entries(wish.name)[wish.offset :]:
        line = _line(entry, wish.opcode == LIST_DIRECTORY_WITH_TIME)
        if len(lines) + len(line) > DATA:
            break
        lines += line
    if not lines:
        raise Refusal(END_OF_FILE)
    return lines


def _line(entry: Entry, with_time: bool) -> bytes:
    text = f"D{entry.name}" if entry.size is None else f"F{entry.name}\t{entry.size}"
    if with_time:  # a folder gets a size too, so that the time is always the third field
        text += ("\t0" if entry.size is None else "") + f"\t{entry.time_utc}"
    line = text.encode() + b"\0"
    return line if len(line) <= DATA else b"S\0"  # S: a skipped entry, which counts as a line


def _rename(server: Server, wish: FileRequest) -> None:
    old, _, rest = wish.data.partition(b"\0")
    server.tree.rename(old, rest.partition(b"\0")[0])


RequestHandler = Callable[[Server, FileRequest], bytes | None]  # returns the data of the ACK; None: no data
HANDLERS: dict[int, RequestHandler] = {
    NONE: lambda server, wish: None,
    TERMINATE_SESSION: lambda server, wish: server.sessions.close(server.client, wish.session),
    RESET_SESSIONS: lambda server, wish: server.sessions.reset(server.client),
    LIST_DIRECTORY: _list,
    OPEN_TO_READ: _open_to_read,
    READ: _read,
    CREATE: _open_to_write,
    WRITE: _write,
    REMOVE_FILE: lambda server, wish: server.tree.remove_file(wish.name),
    MAKE_FOLDER: lambda server, wish: server.tree.make_folder(wish.name),
    REMOVE_FOLDER: lambda server, wish: server.tree.remove_folder(wish.name),
    OPEN_TO_WRITE: _open_to_write,
    TRUNCATE: lambda server, wish: server.tree.truncate(wish.name, wish.offset),
    RENAME: _rename,
    CHECKSUM: lambda server, wish: struct.pack("<I", server.tree.checksum(wish.name)),
    LIST_DIRECTORY_WITH_TIME: _list,
}


def _burst_name(address: tuple[int, int]) -> str:
    return f"file burst {address}"


def _begin_burst(server: Server, port: Port, address: tuple[int, int], wish: FileRequest) -> None:
    """Start to stream a file from an offset, a limited number of messages per tick; or send a NAK."""
    try:
        session = server.sessions.get(server.client, wish.session, server.now_us)
        if not session.file.readable():
            raise Refusal(FAIL)
    except Refusal as reason:
        port.send(_message(address, _pack(wish, NAK, reason.data)))
        return
    step = wish.size if 0 < wish.size <= DATA else DATA
    port.transfers[_burst_name(address)] = (_message(address, payload) for payload in _burst(session.file, wish, step))


def _burst(file: BinaryIO, wish: FileRequest, step: int) -> Iterator[bytes]:
    offset = wish.offset
    for i in range(BURST_MESSAGES):
        try:
            file.seek(offset)
            data = file.read(step)
        except (OSError, ValueError) as reason:  # ValueError: closed in between
            yield _pack(wish, NAK, _refusal(reason), later=i, offset=offset)
            return
        if not data:
            yield _pack(wish, NAK, bytes([END_OF_FILE]), later=i, offset=min(offset, 0xFFFFFFFF), complete=True)
            return
        last = len(data) < step or i == BURST_MESSAGES - 1
        yield _pack(wish, ACK, data, later=i, offset=offset, complete=last)
        if last:
            return
        offset += len(data)


CHUNK = 90  # bytes, LOG_DATA.data
LOG_LIST, LOG_DATA = "log list", "log data"  # names of the transfers


def _logs(node: Node) -> list[LogFile]:
    return node.log.directory.logs() if node.log is not None else []


def request_list(node: Node, port: Port, message: Message) -> None:
    """Send LOG_ENTRY for every log from `start` to `end`. If there are no logs, send one LOG_ENTRY with num_logs 0."""
    logs = _logs(node)
    if not logs:
        port.send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        return
    port.transfers[LOG_LIST] = _entries(logs, message.start, message.end)


def _entries(logs: list[LogFile], first: int, last: int) -> Iterator[Message]:
    for log in logs[first : last + 1]:
        yield dialect.MAVLink_log_entry_message(
            log.id, len(logs), len(logs) - 1, min(log.time_utc, 0xFFFFFFFF), min(log.size, 0xFFFFFFFF)
        )


def request_data(node: Node, port: Port, message: Message) -> None:
    """Send a part of one log, a limited number of messages per tick. A new request replaces the previous one.

    The part ends after `message.count` bytes, or at the end of the log, with a message of fewer than 90 bytes. If the
    log does not exist, one message without data is sent.
    """
    logs = _logs(node)
    if message.id >= len(logs):
        port.transfers.pop(LOG_DATA, None)
        port.send(_data(message.id, message.ofs, b""))
        return
    port.transfers[LOG_DATA] = _stretch(logs[message.id].path, message.id, message.ofs, message.count)


def _data(log_id: int, offset: int, data: bytes) -> Message:
    return dialect.MAVLink_log_data_message(log_id, offset, len(data), list(data.ljust(CHUNK, b"\0")))


def _stretch(path: Path, log_id: int, offset: int, count: int) -> Iterator[Message]:
    end = min(offset + count, 1 << 32)
    try:
        with path.open("rb") as file:
            file.seek(offset)
            while offset < end:
                data = file.read(min(CHUNK, end - offset))
                yield _data(log_id, offset, data)
                offset += len(data)
                if len(data) < CHUNK:
                    return
    except OSError:  # erased in between, or the disk is gone: the log ends here
        yield _data(log_id, min(offset, 0xFFFFFFFF), b"")


def request_end(node: Node, port: Port, message: Message) -> None:
    """Stop the transfers of logs on this port."""
    port.transfers.pop(LOG_LIST, None)
    port.transfers.pop(LOG_DATA, None)


def erase(node: Node, port: Port, message: Message) -> None:
    """Remove every log except the one being written."""
    request_end(node, port, message)
    if node.log is not None:
        node.log.directory.erase()
