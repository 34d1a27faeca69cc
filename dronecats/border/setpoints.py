"""What the agent asks of a vehicle, below the action and above MAVLink."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Hold:
    """Stay at the place, height and heading where this setpoint was first flown."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Yaw at a rate, place and height held."""

    yaw_rate: float  # rad/s, + right


@dataclass(frozen=True, slots=True)
class Velocity:
    """Fly straight ahead at a velocity, heading held by a zero yaw rate."""

    forward: float  # m/s, horizontal, along the nose
    up: float | None  # m/s; None holds the height


Setpoint = Hold | Turn | Velocity
