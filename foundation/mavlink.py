"""The MAVLink dialect everybody here speaks, and PX4's numbers for flight modes.

`development` is the upstream dialect that has CURRENT_MODE and AVAILABLE_MODES beside all of `common`.
Source of the mode numbers: PX4 px4_custom_mode.h.
"""

from dataclasses import dataclass

from pymavlink.dialects.v20 import development as dialect

from foundation import wire

__all__ = ["MODES", "Parser", "Px4Mode", "dialect"]

PX4_AUTOPILOT = dialect.MAV_AUTOPILOT_PX4


@dataclass(frozen=True, slots=True)
class Px4Mode:
    """A flight mode as HEARTBEAT.custom_mode carries it."""

    name: str
    main: int
    sub: int = 0

    @property
    def custom_mode(self) -> int:
        """main << 16 | sub << 24."""
        return self.main << 16 | self.sub << 24


MODES: dict[str, Px4Mode] = {
    mode.name: mode
    for mode in (
        Px4Mode("MANUAL", 1),
        Px4Mode("ALTCTL", 2),
        Px4Mode("POSCTL", 3),
        Px4Mode("ORBIT", 3, 1),
        Px4Mode("READY", 4, 1),
        Px4Mode("TAKEOFF", 4, 2),
        Px4Mode("HOLD", 4, 3),
        Px4Mode("MISSION", 4, 4),
        Px4Mode("RETURN", 4, 5),
        Px4Mode("LAND", 4, 6),
        Px4Mode("FOLLOW", 4, 8),
        Px4Mode("PRECLAND", 4, 9),
        Px4Mode("ACRO", 5),
        Px4Mode("OFFBOARD", 6),
        Px4Mode("STABILIZED", 7),
        Px4Mode("TERMINATION", 10),
    )
}


def mode_name(custom_mode: int) -> str:
    """Return the name of a HEARTBEAT.custom_mode, `main/sub` in numbers when it is none of ours."""
    for mode in MODES.values():
        if mode.custom_mode == custom_mode:
            return mode.name
    return f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"


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
