"""The offboard stream of the agent's setpoints, with the height and place loops that PX4 leaves to us.

With vz = 0 in the body frame, a real PX4 drifts 0.1–0.3 m/s. So this module closes the loops for height and place.
"""

import math
from dataclasses import dataclass, replace

from foundation.frames import Vec3, wrap_pi
from foundation.setpoints import Hold, Setpoint, Sight, Turn, Velocity
from hil.link.streams import TICK_US

HEIGHT_GAIN = 1.0  # 1/s
PLACE_GAIN = 0.9  # 1/s
LINE_GAIN = 1.5  # 1/s
CORRECTION_MAX = 0.6  # m/s
HEADING_GAIN = 1.5  # 1/s
HEADING_RATE_MAX = 0.5  # rad/s
STOPPING_S = 0.6  # s: a hold asked for in motion is put where the vehicle can come to rest, not where it was
BACK_MAX = 0.5  # sine of the angle at which a move may be aimed back to its line
HEADING_REACHED = math.radians(1.0)
LINE_REACHED_M = 0.05
ROUNDING = 1e-6  # rad by which a sum of ticks may fall short of the angle that it makes
YAW_RATE_STILL = math.radians(5.0)  # rad/s: below it a turn is over
GRACE_US = 150_000  # µs, three ticks: the next setpoint comes on the tick at which the last ends, or just after it
GAP_US = 200_000  # µs between two looks at a turn, beyond which the time is not counted as turned
STAMP_US = 1_000  # µs to which the vehicle's stamps are rounded
LATE_MAX_US = 250_000  # µs by which a move may outlast its time and still be taken for one that ended when it should


@dataclass(frozen=True, slots=True)
class Turning:
    """A turn under way. Its heading runs ahead of the vehicle's, which lags by a third of a second."""

    start: float  # rad, 0 = north, clockwise: the heading that the angle is counted from
    yaw_rate: float  # rad/s, + right
    angle: float | None  # rad, signed as the rate; None: as far as the time allows
    ends_us: int | None  # µs, vehicle clock; None: not known yet
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
        return self.angle is not None and self.turned >= abs(self.angle) - ROUNDING


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


@dataclass(frozen=True, slots=True)
class VelocitySetpoint:
    """A velocity along the axes of the heading, and a yaw rate: BODY_NED."""

    velocity_body: Vec3  # m/s, forward, right, down
    yaw_rate: float  # rad/s, + right


@dataclass(frozen=True, slots=True)
class PositionSetpoint:
    """A place and a heading: LOCAL_NED."""

    position_ned: Vec3  # m, local frame of the autopilot
    yaw: float  # rad


OffboardSetpoint = VelocitySetpoint | PositionSetpoint


@dataclass(frozen=True, slots=True)
class Destination:
    """A setpoint of the link's own: fly to this place and heading, for the way to the start pose."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad
    turning: Turning | None = None  # a turn on the way, that ends at the heading


class OffboardStream:
    """Remembers what is being flown and turns it into the setpoint of the next tick.

    A setpoint that moves the vehicle lasts no longer than its decision. When its time is over without a new one, the
    setpoint is a hold.
    """

    def __init__(self) -> None:
        self.setpoint: Setpoint | Destination | None = None
        self._ends_us: int | None = None
        self._place: Vec3 | None = None  # m, local frame, that is being held
        self._height: float | None = None  # m, local z that is being held
        self._heading: float | None = None  # rad, that is being held
        self._turning: Turning | None = None
        self._line: Line | None = None  # that is being flown, or that the last move was on
        self._moved_until_us: int | None = None  # µs, when the last move should have ended

    def fly(
        self,
        setpoint: Setpoint,
        ends_us: int | None = None,
        starts_us: int | None = None,
        seen: Sight | None = None,
    ) -> None:
        """Change what is flown, from `starts_us` until `ends_us` (µs, vehicle clock); None: the next tick, for ever.

        `seen` is the pose from which the setpoint's angles count; None: the held heading. A repeated hold
        keeps its place. The held height stays during level moves, and the held heading stays always.
        """
        if isinstance(self.setpoint, Velocity):
            self._moved_until_us = None if self._ends_us is None else self._ends_us - GRACE_US
        self._ends_us = None if ends_us is None else ends_us + GRACE_US
        if setpoint == self.setpoint and isinstance(setpoint, Hold):
            return
        self._end_turn(starts_us)
        if not (isinstance(setpoint, Turn) and isinstance(self.setpoint, Hold)):
            self._place = None
        if isinstance(self.setpoint, Velocity) and self.setpoint.up is not None:
            self._height = None
        self.setpoint = setpoint
        match setpoint:
            case Turn(yaw_rate, angle, onto_line):
                self._heading = seen.heading if seen else self._heading
                self._line = Line(seen.position_ned, seen.heading + (angle or 0.0)) if seen and onto_line else None
                self._place = self._line.nearest(self._place) if self._line and self._place else self._place
                # a rate lasts a tick at least, so an angle that takes less is asked for as a heading
                is_short = angle is not None and abs(angle) <= abs(yaw_rate) * TICK_US / 1e6 + ROUNDING
                turned = abs(angle) if angle is not None and is_short else 0.0
                self._turning = Turning(self._heading or 0.0, yaw_rate, angle, ends_us, starts_us, turned)
            case Velocity(_, _, bearing):
                self._line = None
                if seen is not None and bearing is not None:
                    self._heading = wrap_pi(seen.heading + bearing)
                    self._line = Line(seen.position_ned, self._heading)

    def _end_turn(self, time_us: int | None) -> None:
        """Hold the heading that the turn has reached by then. Without a time, hold the heading at its end."""
        if self._turning is not None and self._heading is not None:
            until_us = time_us if time_us is not None else self._turning.ends_us
            turning = self._turning if until_us is None else self._turning.until(until_us)
            self._heading = turning.heading
        self._turning = None

    def fly_to(self, place: Destination) -> None:
        """Fly to a place and stay there."""
        self.stop()
        self.setpoint = place

    def stop(self) -> None:
        """Stream nothing any more."""
        self.setpoint, self._ends_us, self._moved_until_us = None, None, None
        self._place, self._height, self._heading, self._turning, self._line = None, None, None, None, None

    def steady(self, position: Vec3, yaw: float, yaw_rate: float) -> bool:
        """Return whether nose (rad, rad/s) and place (m) are where the end of a turn wants them, and stay there."""
        heading = self._heading
        if self._turning is not None:
            if not self._turning.over:
                return False
            heading = self._turning.heading
        if self._line is not None and abs(self._line.beside(position)) > LINE_REACHED_M:
            return False
        there = heading is not None and abs(wrap_pi(heading - yaw)) <= HEADING_REACHED
        return there and abs(yaw_rate) <= YAW_RATE_STILL

    def streamed(self, position: Vec3, velocity: Vec3, yaw: float, time_us: int) -> OffboardSetpoint | None:
        """Return the offboard setpoint for this state (m, m/s, rad, µs), None when nothing is streamed."""
        if self.setpoint is not None and self._ends_us is not None and time_us > self._ends_us:
            self.fly(Hold(), starts_us=time_us)
        if self.setpoint is None:
            return None
        if isinstance(self.setpoint, Destination):
            self._turning = self.setpoint.turning if self._turning is None else self._turning
            self._turning = self._turning.until(time_us) if self._turning else None
            heading = self._turning.heading if self._turning else self.setpoint.yaw
            return PositionSetpoint(self.setpoint.position_ned, heading)
        place, heading = self._held(position, velocity, yaw, time_us)
        match self.setpoint:
            case Hold():
                return PositionSetpoint(place, heading)
            case Turn(yaw_rate):
                assert self._turning is not None
                self._turning = self._turning.until(time_us)
                if self._turning.over:
                    return PositionSetpoint(place, self._turning.heading)
                forward, right = _correction(place, position, yaw)
                return VelocitySetpoint((forward, right, self._height_correction(position)), yaw_rate)
            case Velocity(forward, up):
                down = self._height_correction(position) if up is None else -up
                rate = _clamped(HEADING_GAIN * wrap_pi(heading - yaw), HEADING_RATE_MAX)
                # along the line, whatever the nose still has to turn to it
                off = wrap_pi(heading + self._back_to_line(position, forward) - yaw)
                return VelocitySetpoint((forward * math.cos(off), forward * math.sin(off), down), rate)

    def _held(self, position: Vec3, velocity: Vec3, yaw: float, time_us: int) -> tuple[Vec3, float]:
        """Return the place and the heading that are held, taken here and now where nothing has been held before."""
        stopping_s = self._stopping_s(time_us)
        if self._height is None:
            self._height = position[2] + velocity[2] * stopping_s
        if self._place is None:
            self._place = (position[0] + velocity[0] * stopping_s, position[1] + velocity[1] * stopping_s, self._height)
            if self._line is not None:
                self._place = self._line.nearest(self._place)
        if self._heading is None:
            self._heading = yaw
            if self._turning is not None:
                self._turning = replace(self._turning, start=yaw)
        return (self._place[0], self._place[1], self._height), self._heading

    def _stopping_s(self, time_us: int) -> float:
        """Return how far ahead of the vehicle, in seconds of its velocity, a hold is put.

        A move lasts too long by up to one tick of the autopilot's telemetry, on some links at every step. So the hold
        is put back by this time. Without that, all those steps would be too long.
        """
        late_us = 0 if self._moved_until_us is None else time_us - self._moved_until_us
        return STOPPING_S - (late_us / 1e6 if 0 < late_us <= LATE_MAX_US else 0.0)

    def _back_to_line(self, position: Vec3, forward: float) -> float:
        """Return the angle (rad, + right) by which a move is aimed off its course to come back to its line."""
        if self._line is None or forward <= 0.0:
            return 0.0
        return -math.asin(_clamped(LINE_GAIN * self._line.beside(position) / forward, BACK_MAX))

    def _height_correction(self, position: Vec3) -> float:
        assert self._height is not None
        return _clamped(HEIGHT_GAIN * (self._height - position[2]), CORRECTION_MAX)


class SetpointRate:
    """Says at which ticks a setpoint is sent: at all of them, or so many times a second of vehicle time."""

    def __init__(self, hz: float | None = None) -> None:
        self._period_us = round(1e6 / hz) if hz else 0
        self._due_us = 0

    def due(self, time_us: int) -> bool:
        """Return whether one is due, and take it for sent."""
        early_us = self._due_us - time_us
        if STAMP_US < early_us <= self._period_us:
            return False
        # Count from the due time, or the rate would sink to a divisor of the tick rate. After a pause, count from now.
        # If a tick comes just before the due time, the next is late by a whole period and the rounding of the stamps.
        in_step = -self._period_us - STAMP_US < early_us <= STAMP_US
        self._due_us = (self._due_us if in_step else time_us) + self._period_us
        return True


def _correction(place: Vec3, position: Vec3, yaw: float) -> tuple[float, float]:
    """Return the velocity (m/s, forward and right) that brings a vehicle back to a place."""
    north, east = place[0] - position[0], place[1] - position[1]
    forward = math.cos(yaw) * north + math.sin(yaw) * east
    right = -math.sin(yaw) * north + math.cos(yaw) * east
    return _clamped(PLACE_GAIN * forward, CORRECTION_MAX), _clamped(PLACE_GAIN * right, CORRECTION_MAX)


def _clamped(value: float, most: float) -> float:
    return max(-most, min(most, value))
