"""Setpoints of a vehicle. The agent derives them from actions, and the link sends them through MAVLink."""

from dataclasses import dataclass

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class PicturePose:
    """The estimated pose of a vehicle when a picture was taken. A decision about the picture refers to this pose."""

    position_ned: Vec3  # m, local frame of the autopilot
    heading: float  # rad, 0 = north, clockwise
    roll: float = 0.0  # rad, right side down
    pitch: float = 0.0  # rad, nose up
    gimbal_pitch: float | None = None  # rad, pitch of the camera up from the horizon; None: no gimbal
    carried_on: bool = False  # whether the pose is extrapolated beyond the newest telemetry


@dataclass(frozen=True, slots=True)
class Hold:
    """Stop, and hold place, height and heading."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Yaw at a rate, and hold place and height."""

    yaw_rate: float  # rad/s, + right
    angle: float | None = None  # rad from the `PicturePose`'s heading, with the sign of `yaw_rate`; None: no end
    is_before_move: bool = False  # whether a move follows; if so, the vehicle holds a place on the line of that move


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly at a velocity along a straight line, with the nose along the line.

    If `bearing` is set, the line passes through the position of the `PicturePose` of the decision.
    """

    forward: float  # m/s, horizontal, along the line
    up: float | None  # m/s; None holds the height
    bearing: float | None = None  # rad from the `PicturePose`'s heading, + right; None: along the held heading


Setpoint = Hold | Turn | Velocity
