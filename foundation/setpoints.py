"""Setpoints of a vehicle. The agent derives them from actions, and the link sends them through MAVLink."""

from dataclasses import dataclass

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class Sight:
    """The estimated pose of a vehicle when a picture was taken. A decision on the picture is relative to it."""

    position_ned: Vec3  # m, local frame of the autopilot
    heading: float  # rad, 0 = north, clockwise
    roll: float = 0.0  # rad, right side down
    pitch: float = 0.0  # rad, nose up
    gimbal_pitch: float | None = None  # rad, of the camera, up from the horizon; None: fixed to the body
    carried_on: bool = False  # extrapolated beyond the newest telemetry


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold the place, height and heading at which the vehicle first got this setpoint."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Yaw at a rate and hold place and height."""

    yaw_rate: float  # rad/s, + right
    angle: float | None = None  # rad from the sight's heading, with the sign of the rate; None: no end
    onto_line: bool = False  # a move follows: hold a place on its line, which passes through the sight's place


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly along a straight line at a velocity, with the nose along the line."""

    forward: float  # m/s, horizontal, along the line
    up: float | None  # m/s; None holds the height
    bearing: float | None = None  # rad from the sight's heading, + right, line through its place; None: held heading


Setpoint = Hold | Turn | Velocity
