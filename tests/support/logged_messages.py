"""The MAVLink messages in a tlog, in their order."""

from collections.abc import Collection
from pathlib import Path

from foundation import wire
from foundation.mavlink import Parser, dialect


def logged_messages(path: Path, kinds: Collection[int]) -> list[dialect.MAVLink_message]:
    """Return the messages of these kinds."""
    parser = Parser()
    messages = [message for _, frame in wire.logged_frames(path.read_bytes())[0] for message in parser.feed(frame)]
    return [message for message in messages if message.get_msgId() in kinds]
