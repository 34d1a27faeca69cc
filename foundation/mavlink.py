"""The MAVLink dialect, its parser and packer, and the flight modes of PX4 and of the project's autopilot.

`development` is the upstream dialect that adds CURRENT_MODE and AVAILABLE_MODES to `common`. The numbers of the modes
come from PX4's px4_custom_mode.h.
"""

from dataclasses import dataclass

from pymavlink.dialects.v20 import development as dialect

from foundation import wire

__all__ = ["Packer", "Parser", "dialect", "frame_of"]


class Parser:
    """Parses a byte stream into messages. Garbage is skipped and counted."""

    def __init__(self) -> None:
        self._mav = dialect.MAVLink(None)
        self._rest = b""  # the beginning of an incomplete frame
        self.bad = 0  # count of garbage as in `wire.scan`

    def feed(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Return the messages completed by `data`, in order."""
        messages = []
        for frame in self.frames(data):
            if wire.is_plain(frame):
                messages.append(wire.message(frame))
            else:
                messages += self._decoded(frame)
        return messages

    def frames(self, data: bytes) -> list[bytes]:
        """Return the messages completed by `data` as bytes, for forwarding."""
        data = self._rest + data if self._rest else bytes(data)
        frames, end, bad = wire.scan(data)
        self._rest = data[end:]
        self.bad += bad
        return frames

    def _decoded(self, frame: bytes) -> list[dialect.MAVLink_message]:
        """Return the message of a MAVLink 1 or signed frame; empty if pymavlink rejects it."""
        try:
            return [self._mav.decode(bytearray(frame))]
        except Exception:  # wrong lengths raise other errors besides MAVError, and no error may stop the flight
            self.bad += 1
            return []


def frame_of(message: dialect.MAVLink_message) -> bytes:
    """Return the bytes of a parsed message."""
    frame = message.__dict__.get("_frame")
    return bytes(message.get_msgbuf()) if frame is None else bytes(frame)


def first_field(message: dialect.MAVLink_message) -> bytes:
    """Return the first 4 bytes of a received message's payload: `param_value` of a PARAM_SET or PARAM_VALUE.

    PX4 puts an integer's bytes into this float field, and decoding them as a float may change them (signalling NaN).
    pymavlink's get_payload starts at the wrong byte, because the header of MAVLink 2 is longer. Zeros that MAVLink 2
    has cut from the end are filled in.
    """
    frame = bytes(message.get_msgbuf())
    start = 10 if frame[0] == dialect.PROTOCOL_MARKER_V2 else 6
    return frame[start : start + min(frame[1], 4)].ljust(4, b"\0")


class Packer:
    """Packs the messages of one MAVLink 2 component, with its own sequence numbers."""

    def __init__(self, system: int, component: int) -> None:
        self.system, self.component = system, component
        self._sequence = 0

    def pack(self, message: dialect.MAVLink_message) -> bytes:
        """Return the message as bytes, with the next sequence number.

        Raises struct.error for a value that its field cannot hold, TypeError for a message of another dialect.
        """
        layout = wire.BY_CLASS[type(message)]
        data = layout.frame(message, self._sequence, self.system, self.component)
        self._sequence = (self._sequence + 1) % 256
        return data

    def frame(self, layout: wire.MessageLayout, payload: bytes) -> bytes:
        """Return a payload (`MessageLayout.payload_of`) as a message, with the next sequence number."""
        data = layout.framed(payload, self._sequence, self.system, self.component)
        self._sequence = (self._sequence + 1) % 256
        return data


PX4_AUTOPILOT = dialect.MAV_AUTOPILOT_PX4


@dataclass(frozen=True, slots=True)
class Px4Mode:
    """A flight mode of PX4, by its main and sub mode numbers."""

    name: str
    main: int
    sub: int = 0

    @property
    def custom_mode(self) -> int:
        """The value of HEARTBEAT.custom_mode: main << 16 | sub << 24."""
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
        *(Px4Mode(f"EXTERNAL{n}", 4, 10 + n) for n in range(1, 9)),
        Px4Mode("ACRO", 5),
        Px4Mode("OFFBOARD", 6),
        Px4Mode("STABILIZED", 7),
        Px4Mode("TERMINATION", 10),
    )
}


def mode_name(custom_mode: int) -> str:
    """Return the name of a HEARTBEAT.custom_mode; `main/sub` in numbers for an unknown one."""
    for mode in MODES.values():
        if mode.custom_mode == custom_mode:
            return mode.name
    return f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"
