"""Setpoints of the agent for a vehicle, between actions and MAVLink."""

from dataclasses import dataclass

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class Sight:
    """The estimated pose of a vehicle when a picture was taken. A decision on the picture counts from it."""

    position_ned: Vec3  # m, local frame of the autopilot
    heading: float  # rad, 0 = north, clockwise
    roll: float = 0.0  # rad, right side down
    pitch: float = 0.0  # rad, nose up
    gimbal_pitch: float | None = None  # rad, of the camera, up from the horizon; None: it is fixed to the body
    carried_on: bool = False  # extrapolated beyond the newest telemetry


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay at the place, height and heading where this setpoint was first flown."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Yaw at a rate, place and height held."""

    yaw_rate: float  # rad/s, + right
    angle: float | None = None  # rad from the sight's heading, signed as the rate; None: without end
    onto_line: bool = False  # a move along the new heading follows: hold a place on its line through the sight's place


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly a straight line at a velocity, the nose along it."""

    forward: float  # m/s, horizontal, along the line
    up: float | None  # m/s; None holds the height
    bearing: float | None = None  # rad, + right, from the sight's heading, through its place; None: the heading held


Setpoint = Hold | Turn | Velocity
