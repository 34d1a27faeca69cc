"""MAVLink's gimbal protocol v2 for a gimbal that the autopilot drives itself: manager and device in one component.

Source: mavlink.io/en/services/gimbal_v2.html. The device has the id 1: ids from 1 to 6 are for gimbals without MAVLink
of their own. Clients command only the pitch, an angle from the horizon. Roll stays level. A commanded yaw is ignored.
"""

import math
from typing import Protocol

from autopilot.commander.commander import ACCEPTED, DENIED
from foundation.frames import Quat
from foundation.mavlink import dialect
from foundation.wire import Fields

DEVICE = 1
CAPABILITIES = (
    dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_NEUTRAL
    | dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_ROLL_LOCK
    | dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
    | dialect.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
)
HELD = dialect.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | dialect.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
LEAVE, MYSELF, NOBODY = -1, -2, -3  # ids in DO_GIMBAL_MANAGER_CONFIGURE for who gets control
GimbalClient = tuple[int, int]  # system, component; (0, 0): none


class GimbalDevice(Protocol):
    """The interface of a gimbal. Angles are in rad, positive above the horizon."""

    low: float
    high: float
    pitch: float
    pitch_rate: float
    neutral: float

    def aim(self, pitch: float) -> None:
        """Start to move to a pitch (rad)."""
        ...

    def move(self, rate: float) -> None:
        """Move at a rate (rad/s, + up) until the next command or the end of the range."""
        ...

    def attitude(self, body: Quat) -> Quat:
        """Return the camera's attitude (camera axes → NED) from the body's attitude (FRD → NED)."""
        ...


class GimbalManager:
    """Decides which clients may command the gimbal, and executes their commands."""

    def __init__(self, device: GimbalDevice) -> None:
        self.device = device
        self.primary: GimbalClient = (0, 0)
        self.secondary: GimbalClient = (0, 0)

    def configure(self, source: GimbalClient, senders: tuple[int | None, ...]) -> int:
        """Set the clients in control from parameters 1 to 4 of DO_GIMBAL_MANAGER_CONFIGURE; return MAV_RESULT."""
        if any(sender is None for sender in senders):
            return DENIED
        first, first_component, second, second_component = (int(sender or 0) for sender in senders)
        self.primary = _client(self.primary, source, first, first_component)
        self.secondary = _client(self.secondary, source, second, second_component)
        return ACCEPTED

    def point(self, source: GimbalClient, pitch_deg: float, rate_deg_s: float, flags: int) -> int:
        """Move to a pitch, or at a rate if the pitch is not finite; return MAV_RESULT.

        The flag NEUTRAL has priority over pitch and rate. Returns DENIED while another client is in control, or if
        neither value is finite and the flag is not set.
        """
        if self.primary != (0, 0) and source not in (self.primary, self.secondary):
            return DENIED
        if flags & dialect.GIMBAL_MANAGER_FLAGS_NEUTRAL:
            self.device.aim(self.device.neutral)
        elif math.isfinite(pitch_deg):
            self.device.aim(math.radians(pitch_deg))
        elif math.isfinite(rate_deg_s):
            self.device.move(math.radians(rate_deg_s))
        else:
            return DENIED
        return ACCEPTED

    def information(self, boot_ms: int) -> Fields:
        """Return the fields of GIMBAL_MANAGER_INFORMATION."""
        low, high = self.device.low, self.device.high
        return (boot_ms, CAPABILITIES, DEVICE, 0.0, 0.0, low, high, 0.0, 0.0)

    def device_information(self, boot_ms: int) -> Fields:
        """Return the fields of GIMBAL_DEVICE_INFORMATION."""
        low, high = self.device.low, self.device.high
        return (boot_ms, b"DroneCATS", b"pitch", b"", 0, 0, 0, CAPABILITIES, 0, 0.0, 0.0, low, high, 0.0, 0.0, DEVICE)

    def status(self, boot_ms: int) -> Fields:
        """Return the fields of GIMBAL_MANAGER_STATUS."""
        return (boot_ms, HELD, DEVICE, *self.primary, *self.secondary)

    def attitude_status(self, boot_ms: int) -> Fields:
        """Return GIMBAL_DEVICE_ATTITUDE_STATUS: roll and pitch from the horizon, yaw from the vehicle's nose."""
        flags = HELD | dialect.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
        q = list(self.device.attitude((1.0, 0.0, 0.0, 0.0)))
        return (0, 0, boot_ms, flags, q, 0.0, self.device.pitch_rate, 0.0, 0, 0.0, 0.0, DEVICE)


def _client(before: GimbalClient, source: GimbalClient, system: int, component: int) -> GimbalClient:
    if LEAVE in (system, component):
        return before
    if MYSELF in (system, component):
        return source
    if NOBODY in (system, component):
        return (0, 0) if before == source else before
    return (max(system, 0), max(component, 0))
