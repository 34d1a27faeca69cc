"""The agent's setpoints as PX4's offboard messages, with the height and place loops that PX4 leaves to its client.

A body velocity of vz = 0 drifts 0.1–0.3 m/s on a real PX4, so whatever holds a height or a place here closes that loop.
"""

import math
from dataclasses import dataclass

from dronecats.border.frames import Vec3
from dronecats.border.mavlink import dialect
from dronecats.border.setpoints import Hold, Setpoint, Turn, Velocity

MASK_VELOCITY_YAW_RATE = 0x5C7  # vx, vy, vz, yaw rate
MASK_POSITION_YAW = 0x9F8  # x, y, z, yaw
HEIGHT_GAIN = 1.0  # 1/s
PLACE_GAIN = 0.9  # 1/s
CORRECTION_MAX = 0.6  # m/s
STOPPING_S = 0.6  # s: a hold asked for in motion is put where the vehicle can come to rest, not where it was


@dataclass(frozen=True, slots=True)
class Anchor:
    """Where a setpoint began."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad


class OffboardStream:
    """Remembers what is being flown and turns it into the message for the next tick."""

    def __init__(self) -> None:
        self.setpoint: Setpoint | None = None
        self._anchor: Anchor | None = None
        self._height: float | None = None  # m, local z that is being held

    def fly(self, setpoint: Setpoint) -> None:
        """Change what is flown. A hold that goes on keeps its place; the height is kept through level moves."""
        if setpoint == self.setpoint and isinstance(setpoint, Hold):
            return
        keeps_place = isinstance(setpoint, Turn) and isinstance(self.setpoint, Hold)
        keeps_yaw = keeps_place and self._anchor is not None
        if not keeps_yaw:
            self._anchor = None
        if isinstance(self.setpoint, Velocity) and self.setpoint.up is not None:
            self._height = None
        self.setpoint = setpoint

    def stop(self) -> None:
        """Stream nothing any more."""
        self.setpoint, self._anchor, self._height = None, None, None

    def message(
        self, position: Vec3, velocity: Vec3, yaw: float, time_boot_ms: int, system: int, component: int
    ) -> dialect.MAVLink_message | None:
        """Return the message that flies the setpoint from here, None when nothing is streamed."""
        if self.setpoint is None:
            return None
        if self._height is None:
            self._height = position[2] + velocity[2] * STOPPING_S
        if self._anchor is None:
            rest = (position[0] + velocity[0] * STOPPING_S, position[1] + velocity[1] * STOPPING_S, self._height)
            self._anchor = Anchor(rest, yaw)
        match self.setpoint:
            case Hold():
                x, y, _ = self._anchor.position_ned
                return position_target((x, y, self._height), self._anchor.yaw, time_boot_ms, system, component)
            case Turn(yaw_rate):
                forward, right = self._place_correction(position, yaw)
                # when the turn is over, a hold keeps this place but takes the heading that was reached
                self._anchor = Anchor(self._anchor.position_ned, yaw)
                return velocity_target(
                    (forward, right, self._height_correction(position)), yaw_rate, time_boot_ms, system, component
                )
            case Velocity(forward, up):
                down = self._height_correction(position) if up is None else -up
                return velocity_target((forward, 0.0, down), 0.0, time_boot_ms, system, component)

    def _height_correction(self, position: Vec3) -> float:
        assert self._height is not None
        return _clamped(HEIGHT_GAIN * (self._height - position[2]))

    def _place_correction(self, position: Vec3, yaw: float) -> tuple[float, float]:
        assert self._anchor is not None
        north, east = (self._anchor.position_ned[i] - position[i] for i in (0, 1))
        forward = math.cos(yaw) * north + math.sin(yaw) * east
        right = -math.sin(yaw) * north + math.cos(yaw) * east
        return _clamped(PLACE_GAIN * forward), _clamped(PLACE_GAIN * right)


def velocity_target(
    velocity_body: Vec3, yaw_rate: float, time_boot_ms: int, system: int, component: int
) -> dialect.MAVLink_message:
    """Return SET_POSITION_TARGET_LOCAL_NED in BODY_NED: forward, right, down in m/s and a yaw rate in rad/s."""
    return dialect.MAVLink_set_position_target_local_ned_message(
        time_boot_ms % (1 << 32),
        system,
        component,
        dialect.MAV_FRAME_BODY_NED,
        MASK_VELOCITY_YAW_RATE,
        0, 0, 0, *velocity_body, 0, 0, 0, 0, yaw_rate,
    )  # fmt: skip


def position_target(
    position_ned: Vec3, yaw: float, time_boot_ms: int, system: int, component: int
) -> dialect.MAVLink_message:
    """Return SET_POSITION_TARGET_LOCAL_NED in LOCAL_NED: a place in m and a heading in rad."""
    return dialect.MAVLink_set_position_target_local_ned_message(
        time_boot_ms % (1 << 32),
        system,
        component,
        dialect.MAV_FRAME_LOCAL_NED,
        MASK_POSITION_YAW,
        *position_ned, 0, 0, 0, 0, 0, 0, yaw, 0,
    )  # fmt: skip


def _clamped(speed: float) -> float:
    return max(-CORRECTION_MAX, min(CORRECTION_MAX, speed))
