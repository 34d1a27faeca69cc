"""A camera gimbal. It keeps the camera level in roll and at a pitch from the horizon; yaw follows the vehicle."""

import math

from foundation.camera_mount import GimbalLimits
from foundation.frames import Quat, quat_from_euler, quat_yaw


class Gimbal:
    """Moves the camera to the last commanded pitch (rad, up from the horizon), at a limited rate."""

    def __init__(self, limits: GimbalLimits, pitch_deg: float) -> None:
        """`pitch_deg`: pitch at boot, up from the horizon."""
        self.low, self.high = math.radians(limits.pitch_min_deg), math.radians(limits.pitch_max_deg)
        self.rate_max = math.radians(limits.rate_deg_s)
        self.neutral = min(max(math.radians(pitch_deg), self.low), self.high)
        self.restore()

    def restore(self) -> None:
        """Reset to the state at boot."""
        self.pitch = self.neutral
        self.pitch_rate = 0.0  # rad/s
        self._wanted: float | None = self.pitch  # rad, commanded pitch; None: a rate is commanded
        self._rate = 0.0  # rad/s, + up; the commanded rate

    def aim(self, pitch: float) -> None:
        """Command a pitch (rad), which is limited to the gimbal's range."""
        self._wanted = min(max(pitch, self.low), self.high)

    def move(self, rate: float) -> None:
        """Command a rate (rad/s, + up). It lasts until another command or the end of the range."""
        self._wanted, self._rate = None, min(max(rate, -self.rate_max), self.rate_max)

    def advance(self, seconds: float) -> None:
        """Advance the motion by `seconds`."""
        reach = self.rate_max * seconds
        wanted = self.pitch + self._rate * seconds if self._wanted is None else self._wanted
        step = min(max(wanted - self.pitch, -reach), reach)
        before, self.pitch = self.pitch, min(max(self.pitch + step, self.low), self.high)
        self.pitch_rate = (self.pitch - before) / seconds

    def attitude(self, body: Quat) -> Quat:
        """Return the attitude of the camera (camera axes → NED) on a body with this attitude (FRD → NED)."""
        return quat_from_euler(0.0, self.pitch, quat_yaw(body))
