"""Which autopilot is at the other end: AUTOPILOT_VERSION and HEARTBEAT, read."""

from dataclasses import dataclass

from foundation.mavlink import dialect
from foundation.px4 import PX4_AUTOPILOT

KINDS = {0: "", 64: "alpha", 128: "beta", 192: "rc", 255: ""}  # FIRMWARE_VERSION_TYPE; 0 is a developer's build
NAMES = {0: "a generic autopilot", 3: "ArduPilot", PX4_AUTOPILOT: "PX4", 8: "no autopilot"}


@dataclass(frozen=True, slots=True)
class Firmware:
    """What an autopilot says of its own firmware."""

    version: str  # major.minor.patch, with alpha, beta or rc where it is none that was released
    git: str  # first 8 bytes of the commit's hash, in hexadecimal; empty when not told
    vendor: int  # USB ids of the board, 0 when not told
    product: int
    uid: int  # of the board, 0 when not told
    capabilities: int  # MAV_PROTOCOL_CAPABILITY bits

    def __str__(self) -> str:
        return f"PX4 {self.version}" + (f" ({self.git[:8]})" if self.git else "")


def firmware(message: dialect.MAVLink_message) -> Firmware:
    """Return what an AUTOPILOT_VERSION says. PX4 writes the hash with its least significant byte first."""
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
    """Return the name of a HEARTBEAT.autopilot, for a sentence."""
    return NAMES.get(autopilot, f"an autopilot of MAV_AUTOPILOT {autopilot}")
