"""The way that a decision asks for: the heading of a turn as time goes, and the line of a move. Pure geometry."""

import math
from dataclasses import dataclass, replace

from foundation.frames import Vec3, wrap_pi

GAP_US = 200_000  # µs between two looks at a turn, beyond which the time is not counted as turned


@dataclass(frozen=True, slots=True)
class Turning:
    """A turn under way. Its heading runs ahead of the vehicle's, which lags by a third of a second."""

    start: float  # rad, 0 = north, clockwise: the heading that the angle is counted from
    yaw_rate: float  # rad/s, + right
    angle: float | None  # rad, signed as the rate; None: as far as the time allows
    ends_us: int | None  # µs, vehicle clock; None while nobody has said
    counted_us: int | None = None  # µs, until when it has been counted; None: not begun
    turned: float = 0.0  # rad, unsigned, by then

    def until(self, time_us: int) -> "Turning":
        """Return the turn as it is wanted at a time (µs). A time in which nothing was flown is not counted."""
        end_us = time_us if self.ends_us is None else min(time_us, self.ends_us)
        since_us = end_us if self.counted_us is None else self.counted_us
        turned = self.turned + abs(self.yaw_rate) * max(0, min(end_us - since_us, GAP_US)) / 1e6
        most = turned if self.angle is None else min(turned, abs(self.angle))
        return replace(self, counted_us=end_us, turned=most)

    @property
    def heading(self) -> float:
        """The heading (rad) that is wanted."""
        return wrap_pi(self.start + math.copysign(self.turned, self.yaw_rate))

    @property
    def over(self) -> bool:
        """Whether the wanted heading has come to the end of the angle."""
        return self.angle is not None and self.turned >= abs(self.angle)


@dataclass(frozen=True, slots=True)
class Line:
    """A level straight line over the ground."""

    through: Vec3  # m, local frame; its height is of no account
    course: float  # rad, 0 = north, clockwise

    def beside(self, position: Vec3) -> float:
        """Return how far to the right of the line a place is (m)."""
        north, east = position[0] - self.through[0], position[1] - self.through[1]
        return math.cos(self.course) * east - math.sin(self.course) * north

    def nearest(self, position: Vec3) -> Vec3:
        """Return the place on the line that is nearest to another, at its height."""
        right = self.beside(position)
        north, east = math.sin(self.course) * right, -math.cos(self.course) * right
        return (position[0] + north, position[1] + east, position[2])
