"""Reads the name and version of the autopilot on a link, and makes the setpoint messages that it accepts.

The autopilot is a PX4 or this project's own. The following was measured with PX4 1.15. PX4 accepts setpoints only in
the frames LOCAL_NED and BODY_NED. It rejects a type mask without vz (0x5E7) or without any value (0xDFF), and Offboard
then times out. Setpoints below 2 Hz count as lost; once they are faster again, PX4 returns to Offboard
without a mode command. PX4 reduces the rates of its messages until the radio can carry them. It sends STATUSTEXT only
on a link with a ground station.
"""

from dataclasses import dataclass

from foundation.mavlink import PX4_AUTOPILOT, dialect
from hil.link.offboard import OffboardSetpoint, PositionSetpoint, VelocitySetpoint

KINDS = {0: "", 64: "alpha", 128: "beta", 192: "rc", 255: ""}  # FIRMWARE_VERSION_TYPE; 0: own build, 255: release
NAMES = {0: "a generic autopilot", 3: "ArduPilot", PX4_AUTOPILOT: "PX4", 8: "no autopilot"}


@dataclass(frozen=True, slots=True)
class Firmware:
    """The firmware of an autopilot."""

    version: str  # major.minor.patch, with alpha, beta or rc before a release
    git: str  # first 8 bytes of the commit's hash, in hexadecimal; empty: not sent
    vendor: int  # USB vendor id of the board; 0: not sent
    product: int  # USB product id of the board; 0: not sent
    uid: int  # id of the board; 0: not sent
    capabilities: int  # MAV_PROTOCOL_CAPABILITY bits

    def __str__(self) -> str:
        return f"PX4 {self.version}" + (f" ({self.git[:8]})" if self.git else "")


def firmware(message: dialect.MAVLink_message) -> Firmware:
    """Return the firmware of an AUTOPILOT_VERSION. PX4 writes the hash with its least significant byte first."""
    number = message.flight_sw_version
    major, minor, patch, kind = (number >> shift & 0xFF for shift in (24, 16, 8, 0))
    suffix = KINDS.get(kind, f"type {kind}")
    custom = bytes(message.flight_custom_version)
    return Firmware(
        version=f"{major}.{minor}.{patch}" + (f"-{suffix}" if suffix else ""),
        git=custom[::-1].hex() if any(custom) else "",
        vendor=message.vendor_id,
        product=message.product_id,
        uid=message.uid,
        capabilities=message.capabilities,
    )


def kind_name(autopilot: int) -> str:
    """Return the name of an autopilot (HEARTBEAT.autopilot) for use in a sentence."""
    return NAMES.get(autopilot, f"an autopilot of MAV_AUTOPILOT {autopilot}")


VELOCITY_YAW_RATE = 0x5C7  # type mask: use only vx, vy, vz and the yaw rate
POSITION_YAW = 0x9F8  # type mask: use only x, y, z and the yaw


def setpoint_message(
    setpoint: OffboardSetpoint, time_boot_ms: int, system: int, component: int
) -> dialect.MAVLink_message:
    """Return SET_POSITION_TARGET_LOCAL_NED with a frame and mask that a real PX4 accepts."""
    values: tuple[float, ...]
    match setpoint:
        case VelocitySetpoint(velocity_body, yaw_rate):
            frame, mask = dialect.MAV_FRAME_BODY_NED, VELOCITY_YAW_RATE
            values = (0, 0, 0, *velocity_body, 0, 0, 0, 0, yaw_rate)
        case PositionSetpoint(position_ned, yaw):
            frame, mask = dialect.MAV_FRAME_LOCAL_NED, POSITION_YAW
            values = (*position_ned, 0, 0, 0, 0, 0, 0, yaw, 0)
    return dialect.MAVLink_set_position_target_local_ned_message(
        time_boot_ms % (1 << 32), system, component, frame, mask, *values
    )
