"""Converts the agent's setpoints to the stream of offboard setpoints for PX4.

If a setpoint has vz = 0 in the body frame, a real PX4 drifts at 0.1–0.3 m/s. So this module corrects height and place.
"""

import math
from dataclasses import dataclass, replace

from foundation.frames import Vec3, wrap_pi
from foundation.setpoints import Hold, PicturePose, Setpoint, Turn, Velocity
from hil.link.streams import TICK_US

HEIGHT_GAIN = 1.0  # 1/s, vertical speed per metre from the held height
PLACE_GAIN = 0.9  # 1/s, speed per metre from the held place
LINE_GAIN = 1.5  # 1/s, speed of a move towards its line, per metre of distance from the line
CORRECTION_MAX = 0.6  # m/s, largest correction per axis
HEADING_GAIN = 1.5  # 1/s, yaw rate per radian from the held heading, in a move
HEADING_RATE_MAX = 0.5  # rad/s, limit of this yaw rate
STOPPING_S = 0.6  # s; the held place is ahead of a moving vehicle by velocity × this time, its room to stop
BACK_MAX = 0.5  # sine of the largest angle by which a move turns towards its line
HEADING_REACHED = math.radians(1.0)
LINE_REACHED_M = 0.05
ROUNDING = 1e-6  # rad, tolerance for rounding errors of an angle that is summed over ticks
YAW_RATE_STILL = math.radians(5.0)  # rad/s; above this yaw rate, the heading has not settled
GRACE_US = 150_000  # µs, three ticks; a setpoint lasts this much longer, because the next one may come a little late
GAP_US = 200_000  # µs; the most time that counts between two updates of a turn
STAMP_US = 1_000  # µs, resolution of the vehicle's time stamps
LATE_MAX_US = 250_000  # µs; if a move ends late by more than this, the delay does not change the held place


@dataclass(frozen=True, slots=True)
class TurnProgress:
    """A turn in progress. The vehicle's heading lags behind its commanded heading by a third of a second."""

    start: float  # rad, 0 = north, clockwise: heading at the start of the turn
    yaw_rate: float  # rad/s, + right
    angle: float | None  # rad, with the sign of the rate; None: the turn lasts until `ends_us`
    ends_us: int | None  # µs, vehicle clock; None: no end time
    counted_us: int | None = None  # µs, vehicle clock of the last update; None: not begun
    turned: float = 0.0  # rad, unsigned, commanded until the last update

    def until(self, time_us: int) -> "TurnProgress":
        """Return the turn updated to a time (µs)."""
        end_us = time_us if self.ends_us is None else min(time_us, self.ends_us)
        since_us = end_us if self.counted_us is None else self.counted_us
        turned = self.turned + abs(self.yaw_rate) * max(0, min(end_us - since_us, GAP_US)) / 1e6
        most = turned if self.angle is None else min(turned, abs(self.angle))
        return replace(self, counted_us=end_us, turned=most)

    @property
    def heading(self) -> float:
        """The commanded heading (rad)."""
        return wrap_pi(self.start + math.copysign(self.turned, self.yaw_rate))

    @property
    def over(self) -> bool:
        """Whether the commanded heading has reached the end of the angle."""
        return self.angle is not None and self.turned >= abs(self.angle) - ROUNDING


@dataclass(frozen=True, slots=True)
class Line:
    """A straight horizontal line."""

    through: Vec3  # m, a point of the line in the local frame; its height is not used
    course: float  # rad, 0 = north, clockwise

    def beside(self, position: Vec3) -> float:
        """Return how far (m) a position is to the right of the line."""
        north, east = position[0] - self.through[0], position[1] - self.through[1]
        return math.cos(self.course) * east - math.sin(self.course) * north

    def nearest(self, position: Vec3) -> Vec3:
        """Return the point of the line that is nearest to `position`, at the height of `position`."""
        right = self.beside(position)
        north, east = math.sin(self.course) * right, -math.cos(self.course) * right
        return (position[0] + north, position[1] + east, position[2])


@dataclass(frozen=True, slots=True)
class VelocitySetpoint:
    """A velocity in the frame BODY_NED (axes along the heading) and a yaw rate."""

    velocity_body: Vec3  # m/s, forward, right, down
    yaw_rate: float  # rad/s, + right


@dataclass(frozen=True, slots=True)
class PositionSetpoint:
    """A position in the frame LOCAL_NED, and a heading."""

    position_ned: Vec3  # m, local frame of the autopilot
    yaw: float  # rad, 0 = north, clockwise


OffboardSetpoint = VelocitySetpoint | PositionSetpoint


@dataclass(frozen=True, slots=True)
class Destination:
    """A setpoint of the link itself: fly to this place and heading. Used to reach the start pose."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad, 0 = north, clockwise
    turning: TurnProgress | None = None  # a turn on the way that ends at `yaw`


class OffboardStream:
    """Stores the present setpoint, and computes the offboard setpoint of each tick from it.

    When the time of a setpoint is over and no new setpoint has come, the vehicle holds. So a late decision does not
    extend a motion.
    """

    def __init__(self) -> None:
        self.setpoint: Setpoint | Destination | None = None
        self._ends_us: int | None = None
        self._place: Vec3 | None = None  # m, local frame: the held place
        self._height: float | None = None  # m, z in the local frame: the held height
        self._heading: float | None = None  # rad: the held heading
        self._turning: TurnProgress | None = None
        self._line: Line | None = None  # line of the present, next or last move
        self._moved_until_us: int | None = None  # µs, vehicle clock when the last move should have ended

    def fly(
        self,
        setpoint: Setpoint,
        ends_us: int | None = None,
        starts_us: int | None = None,
        seen: PicturePose | None = None,
    ) -> None:
        """Fly a setpoint from `starts_us` (None: the next tick) until `ends_us` (None: no end), in µs, vehicle clock.

        The setpoint's angles count from the pose `seen`, or without it from the held heading. A repeated hold keeps its
        place. Level moves keep the held height. The held heading changes only by turns and by moves with a bearing.
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
                # a yaw rate lasts at least one tick, so a shorter turn is commanded as a heading
                is_short = angle is not None and abs(angle) <= abs(yaw_rate) * TICK_US / 1e6 + ROUNDING
                turned = abs(angle) if angle is not None and is_short else 0.0
                self._turning = TurnProgress(self._heading or 0.0, yaw_rate, angle, ends_us, starts_us, turned)
            case Velocity(_, _, bearing):
                self._line = None
                if seen is not None and bearing is not None:
                    self._heading = wrap_pi(seen.heading + bearing)
                    self._line = Line(seen.position_ned, self._heading)

    def _end_turn(self, time_us: int | None) -> None:
        """End the turn, and hold its commanded heading at `time_us` (µs), or at its end time if `time_us` is None."""
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
        """End the stream, and forget the held place, height and heading."""
        self.setpoint, self._ends_us, self._moved_until_us = None, None, None
        self._place, self._height, self._heading, self._turning, self._line = None, None, None, None, None

    def steady(self, position: Vec3, yaw: float, yaw_rate: float) -> bool:
        """Return whether a turn is over, and heading (rad, rad/s) and position (m) have settled."""
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
        """Return the offboard setpoint for this state (m, m/s, rad, µs); None: there is no setpoint."""
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
                # fly along the line even while the nose still turns towards it
                off = wrap_pi(heading + self._back_to_line(position, forward) - yaw)
                return VelocitySetpoint((forward * math.cos(off), forward * math.sin(off), down), rate)

    def _held(self, position: Vec3, velocity: Vec3, yaw: float, time_us: int) -> tuple[Vec3, float]:
        """Return the held place and heading. A value that is not held yet is set from the present state."""
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
        """Return how far ahead of the vehicle a hold is placed, in seconds of its velocity.

        A move may end late, by up to one tick of telemetry. On some links, every move ends late. The hold is then
        nearer by the way flown in this delay. Otherwise the moves would be too long.
        """
        late_us = 0 if self._moved_until_us is None else time_us - self._moved_until_us
        return STOPPING_S - (late_us / 1e6 if 0 < late_us <= LATE_MAX_US else 0.0)

    def _back_to_line(self, position: Vec3, forward: float) -> float:
        """Return the angle (rad, + right) by which a move turns off its course to return to its line."""
        if self._line is None or forward <= 0.0:
            return 0.0
        return -math.asin(_clamped(LINE_GAIN * self._line.beside(position) / forward, BACK_MAX))

    def _height_correction(self, position: Vec3) -> float:
        assert self._height is not None
        return _clamped(HEIGHT_GAIN * (self._height - position[2]), CORRECTION_MAX)


class SetpointRate:
    """Selects the ticks at which a setpoint is sent: every tick, or `hz` ticks per second of vehicle time."""

    def __init__(self, hz: float | None = None) -> None:
        self._period_us = round(1e6 / hz) if hz else 0
        self._due_us = 0

    def due(self, time_us: int) -> bool:
        """Return whether a setpoint is due. A due setpoint counts as sent."""
        early_us = self._due_us - time_us
        if STAMP_US < early_us <= self._period_us:
            return False
        # The next due time is a period after the last; otherwise the rate would fall to a divisor of the tick rate.
        # After a pause (the setpoint is late by more than a period plus STAMP_US), it is a period from now.
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
