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
    """Fly straight ahead at a velocity, the heading held: what turns have asked for is in it, reached or not."""

    forward: float  # m/s, horizontal, along that heading
    up: float | None  # m/s; None holds the height


Setpoint = Hold | Turn | Velocity
