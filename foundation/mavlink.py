"""The MAVLink dialect everybody here speaks.

`development` is the upstream dialect that has CURRENT_MODE and AVAILABLE_MODES beside all of `common`.
"""

from pymavlink.dialects.v20 import development as dialect

from foundation import wire

__all__ = ["Packer", "Parser", "dialect", "frame_of"]


class Parser:
    """Turns a byte stream from a wire into messages; garbage is skipped and counted, never raised."""

    def __init__(self) -> None:
        self._mav = _tolerant()
        self._rest = b""  # the beginning of a frame whose end has not come yet
        self.bad = 0

    def feed(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Return the messages completed by `data`, in order."""
        data = self._rest + data if self._rest else bytes(data)
        messages, end = wire.frames(data)
        self._rest = data[end:]
        if self._rest and not wire.incomplete(self._rest):
            messages += self._feed_unusual(self._rest)
        return messages

    def frames(self, data: bytes) -> list[bytes]:
        """Return the messages completed by `data` as their bytes on the wire, for whoever only passes them on."""
        data = self._rest + data if self._rest else bytes(data)
        found, end = wire.split(data)
        self._rest = data[end:]
        if self._rest and not wire.incomplete(self._rest):
            found += [frame_of(message) for message in self._feed_unusual(self._rest)]
        return found

    def _feed_unusual(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Let pymavlink parse what is not plain MAVLink 2 and all that follows; keep what it could not finish."""
        try:
            messages = self._mav.parse_buffer(data) or []
        except Exception:  # pymavlink raises more than MAVError on hostile lengths; a wire must never stop the flight
            self._mav, self._rest = _tolerant(), b""
            self.bad += 1
            return []
        self._rest = bytes(self._mav.buf[self._mav.buf_index :])
        self._mav.buf, self._mav.buf_index = bytearray(), 0
        good = [m for m in messages if m.get_msgId() >= 0]
        self.bad += len(messages) - len(good)
        return good


def frame_of(message: dialect.MAVLink_message) -> bytes:
    """Return a message that was parsed as its bytes on the wire."""
    frame = message.__dict__.get("_frame")
    return bytes(message.get_msgbuf()) if frame is None else bytes(frame)


def _tolerant() -> dialect.MAVLink:
    mav = dialect.MAVLink(None)
    mav.robust_parsing = True
    return mav


class Packer:
    """Turns messages into the bytes of one MAVLink 2 component, with its own sequence numbers."""

    def __init__(self, system: int, component: int) -> None:
        self.system, self.component = system, component
        self._sequence = 0

    def pack(self, message: dialect.MAVLink_message) -> bytes:
        """Return the message as bytes of the wire, next sequence number.

        Raises struct.error for a value that its field cannot hold, TypeError for what is no message of the dialect.
        """
        layout = wire.BY_CLASS[type(message)]
        data = layout.frame(message, self._sequence, self.system, self.component)
        self._sequence = (self._sequence + 1) % 256
        return data
