"""PX4's numbers for flight modes, which our autopilot has too. Source: px4_custom_mode.h."""

from dataclasses import dataclass

from foundation.mavlink import dialect

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
