"""PX4 as a link meets it: its modes, what its offboard takes, and what it does by itself. All of it in this file.

Sources: px4_custom_mode.h for the modes; what a PX4 1.15 was measured to take and to refuse for the rest. Only the
frames LOCAL_NED and BODY_NED count as setpoints; a mask that leaves vz out (0x5E7) or everything (0xDFF) is called
invalid and times out; a stream slower than 2 Hz is lost, and comes back without a mode command. Rates that a radio
cannot carry are divided until they fit. STATUSTEXT goes only to a wire on which a ground station was heard.
"""

from foundation.mavlink import dialect
from foundation.px4 import MODES, PX4_AUTOPILOT
from foundation.px4 import mode_name as name_of
from hil.link.offboard import OffboardSetpoint, PositionSetpoint, VelocitySetpoint

VELOCITY_YAW_RATE = 0x5C7  # type mask: vx, vy, vz, yaw rate
POSITION_YAW = 0x9F8  # type mask: x, y, z, yaw
LEADS_TO = {"TAKEOFF": ("HOLD",), "RETURN": ("LAND", "HOLD")}
ENDINGS = {"land": "LAND", "return": "RETURN", "hold": "HOLD"}


class Px4:
    """The family of PX4, which our own autopilot speaks as."""

    name = "PX4"
    autopilot = int(PX4_AUTOPILOT)
    homeward = ("LAND", "RETURN")  # one that has landed goes back to the mode before

    def mode_name(self, custom_mode: int) -> str:
        """Return the mode of a HEARTBEAT or CURRENT_MODE, `main/sub` in numbers when it is none that we know."""
        return name_of(custom_mode)

    def mode_parameters(self, mode: str) -> tuple[float, float]:
        """Return the main and the sub mode. Raises KeyError for a mode that there is not."""
        return MODES[mode].main, MODES[mode].sub

    def goes_on_to(self, mode: str) -> tuple[str, ...]:
        """Return the modes into which it goes on by itself from this one."""
        return LEADS_TO.get(mode, ())

    def ending(self, then: str) -> str:
        """Return the mode that ends a flight as asked: land, return or hold."""
        return ENDINGS[then]

    def setpoint_message(
        self, setpoint: OffboardSetpoint, time_boot_ms: int, system: int, component: int
    ) -> dialect.MAVLink_message:
        """Return SET_POSITION_TARGET_LOCAL_NED in the frames and masks that a real PX4 takes."""
        stamp = time_boot_ms % (1 << 32)
        match setpoint:
            case VelocitySetpoint(velocity_body, yaw_rate):
                return dialect.MAVLink_set_position_target_local_ned_message(
                    stamp,
                    system,
                    component,
                    dialect.MAV_FRAME_BODY_NED,
                    VELOCITY_YAW_RATE,
                    0, 0, 0, *velocity_body, 0, 0, 0, 0, yaw_rate,
                )  # fmt: skip
            case PositionSetpoint(position_ned, yaw):
                return dialect.MAVLink_set_position_target_local_ned_message(
                    stamp,
                    system,
                    component,
                    dialect.MAV_FRAME_LOCAL_NED,
                    POSITION_YAW,
                    *position_ned, 0, 0, 0, 0, 0, 0, yaw, 0,
                )  # fmt: skip


PX4 = Px4()
