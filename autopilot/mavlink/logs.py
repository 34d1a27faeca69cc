"""Download of the flight logs: LOG_REQUEST_LIST, _DATA, _END, LOG_ERASE. Logs are numbered from 0, as PX4 does it."""

from collections.abc import Iterator
from pathlib import Path

from autopilot.logging.directory import LogFile
from autopilot.mavlink.node import Node
from autopilot.mavlink.port import Port
from autopilot.mavlink.telemetry_source import Message
from foundation.mavlink import dialect

CHUNK = 90  # bytes, LOG_DATA.data
LIST, DATA = "log list", "log data"  # names of the transfers


def _logs(node: Node) -> list[LogFile]:
    return node.log.directory.logs() if node.log is not None else []


def request_list(node: Node, port: Port, message: Message) -> None:
    """Send LOG_ENTRY for every log from `start` to `end`; one with num_logs 0 when there is none at all."""
    logs = _logs(node)
    if not logs:
        port.send(dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        return
    port.transfers[LIST] = _entries(logs, message.start, message.end)


def _entries(logs: list[LogFile], first: int, last: int) -> Iterator[Message]:
    for log in logs[first : last + 1]:
        yield dialect.MAVLink_log_entry_message(
            log.id, len(logs), len(logs) - 1, min(log.time_utc, 0xFFFFFFFF), min(log.size, 0xFFFFFFFF)
        )


def request_data(node: Node, port: Port, message: Message) -> None:
    """Send a stretch of one log, a bounded number of messages per tick; a new request takes the place of the last.

    The stretch ends with the count asked for, or with a message of fewer than 90 bytes at the end of the log, which is
    also the answer for a log that does not exist.
    """
    logs = _logs(node)
    if message.id >= len(logs):
        port.transfers.pop(DATA, None)
        port.send(_data(message.id, message.ofs, b""))
        return
    port.transfers[DATA] = _stretch(logs[message.id].path, message.id, message.ofs, message.count)


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
    """Stop what is being sent."""
    port.transfers.pop(LIST, None)
    port.transfers.pop(DATA, None)


def erase(node: Node, port: Port, message: Message) -> None:
    """Remove every log but the one being written."""
    request_end(node, port, message)
    if node.log is not None:
        node.log.directory.erase()
