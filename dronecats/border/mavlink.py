"""The MAVLink dialect everybody here speaks, and PX4's numbers for flight modes.

`development` is the upstream dialect that has CURRENT_MODE and AVAILABLE_MODES beside all of `common`.
Source of the mode numbers: PX4 px4_custom_mode.h.
"""

from dataclasses import dataclass

from pymavlink.dialects.v20 import development as dialect

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
        self._mav = dialect.MAVLink(None)
        self._mav.robust_parsing = True
        self.bad = 0

    def feed(self, data: bytes) -> list[dialect.MAVLink_message]:
        """Return the messages completed by `data`, in order."""
        try:
            messages = self._mav.parse_buffer(data) or []
        except Exception:  # pymavlink raises more than MAVError on hostile lengths; a wire must never stop the flight
            self._mav = dialect.MAVLink(None)
            self._mav.robust_parsing = True
            self.bad += 1
            return []
        good = [m for m in messages if m.get_msgId() >= 0]
        self.bad += len(messages) - len(good)
        return good


class Packer:
    """Turns messages into the bytes of one MAVLink 2 component, with its own sequence numbers."""

    def __init__(self, system: int, component: int) -> None:
        self._mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self.system, self.component = system, component

    def pack(self, message: dialect.MAVLink_message) -> bytes:
        """Return the message as bytes of the wire, next sequence number."""
        data: bytes = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return data
