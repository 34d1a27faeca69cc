"""The agent's setpoints as offboard targets, with the height and place loops that PX4 leaves to its client.

A body velocity of vz = 0 drifts 0.1–0.3 m/s on a real PX4, so whatever holds a height or a place here closes that loop.
"""

import math
from dataclasses import dataclass

from dronecats.border.frames import Vec3, wrap_pi
from dronecats.border.mavlink import dialect
from dronecats.border.setpoints import Hold, Setpoint, Turn, Velocity

MASK_VELOCITY_YAW_RATE = 0x5C7  # vx, vy, vz, yaw rate
MASK_POSITION_YAW = 0x9F8  # x, y, z, yaw
HEIGHT_GAIN = 1.0  # 1/s
PLACE_GAIN = 0.9  # 1/s
CORRECTION_MAX = 0.6  # m/s
HEADING_GAIN = 1.5  # 1/s
HEADING_RATE_MAX = 0.5  # rad/s
STOPPING_S = 0.6  # s: a hold asked for in motion is put where the vehicle can come to rest, not where it was
TURN_GAP_US = 200_000  # µs between two targets of a turn beyond which the time is not counted as turned
GRACE_US = 150_000  # µs, three ticks: what is flown next is said on the tick at which the last ends, or just after it
LATE_MAX_US = 250_000  # µs by which a move may outlast its time and still be taken for one that ended when it should


@dataclass(frozen=True, slots=True)
class VelocityTarget:
    """A velocity along the axes of the heading, and a yaw rate: BODY_NED."""

    velocity_body: Vec3  # m/s, forward, right, down
    yaw_rate: float  # rad/s, + right


@dataclass(frozen=True, slots=True)
class PositionTarget:
    """A place and a heading: LOCAL_NED."""

    position_ned: Vec3  # m, local frame of the autopilot
    yaw: float  # rad


Target = VelocityTarget | PositionTarget


@dataclass(frozen=True, slots=True)
class Place:
    """A setpoint of the link's own: fly to this place and heading, for the way to the start pose."""

    position_ned: Vec3  # m, local frame
    yaw: float  # rad


@dataclass(frozen=True, slots=True)
class Turning:
    """A turn under way."""

    yaw_rate: float  # rad/s
    counted_us: int | None  # µs, until when its angle has been counted; None: not begun
    ends_us: int | None  # µs, None while nobody has said


class OffboardStream:
    """Remembers what is being flown and turns it into the target for the next tick.

    What moves the vehicle lasts no longer than the decision behind it: when its time is over and nothing else has been
    said, it has become a hold.
    """

    def __init__(self) -> None:
        self.setpoint: Setpoint | Place | None = None
        self._ends_us: int | None = None
        self._place: Vec3 | None = None  # m, local frame, that is being held
        self._height: float | None = None  # m, local z that is being held
        self._heading: float | None = None  # rad, that is being held; what turns have asked for is in it
        self._turn: Turning | None = None
        self._moved_until_us: int | None = None  # µs, when the last move should have ended

    def fly(self, setpoint: Setpoint, ends_us: int | None = None, starts_us: int | None = None) -> None:
        """Change what is flown, from `starts_us` until `ends_us` (µs, vehicle clock); None: the next target, for ever.

        A hold that goes on keeps its place; the height is kept through level moves, the heading through everything.
        """
        if isinstance(self.setpoint, Velocity):
            self._moved_until_us = None if self._ends_us is None else self._ends_us - GRACE_US
        self._ends_us = None if ends_us is None else ends_us + GRACE_US
        if setpoint == self.setpoint and isinstance(setpoint, Hold):
            return
        if not (isinstance(setpoint, Turn) and isinstance(self.setpoint, Hold)):
            self._place = None
        if isinstance(self.setpoint, Velocity) and self.setpoint.up is not None:
            self._height = None
        if isinstance(setpoint, Turn):
            self._turned_until(starts_us)
            self._turn = Turning(setpoint.yaw_rate, starts_us, ends_us)
        self.setpoint = setpoint

    def fly_to(self, place: Place) -> None:
        """Fly to a place and stay there."""
        self.stop()
        self.setpoint = place

    def stop(self) -> None:
        """Stream nothing any more."""
        self.setpoint, self._ends_us, self._turn = None, None, None
        self._place, self._height, self._heading, self._moved_until_us = None, None, None, None

    def target(self, position: Vec3, velocity: Vec3, yaw: float, time_us: int) -> Target | None:
        """Return what flies the setpoint from here (m, m/s, rad, µs), None when nothing is streamed."""
        if self.setpoint is not None and self._ends_us is not None and time_us > self._ends_us:
            self.fly(Hold())
        if self.setpoint is None:
            return None
        if isinstance(self.setpoint, Place):
            return PositionTarget(self.setpoint.position_ned, self.setpoint.yaw)
        stopping_s = self._stopping_s(time_us)
        if self._height is None:
            self._height = position[2] + velocity[2] * stopping_s
        if self._place is None:
            self._place = (position[0] + velocity[0] * stopping_s, position[1] + velocity[1] * stopping_s, self._height)
        heading = self._turned(yaw, time_us)
        match self.setpoint:
            case Hold():
                return PositionTarget((self._place[0], self._place[1], self._height), heading)
            case Turn(yaw_rate):
                forward, right = self._place_correction(position, yaw)
                return VelocityTarget((forward, right, self._height_correction(position)), yaw_rate)
            case Velocity(forward, up):
                down = self._height_correction(position) if up is None else -up
                off = wrap_pi(heading - yaw)
                rate = max(-HEADING_RATE_MAX, min(HEADING_RATE_MAX, HEADING_GAIN * off))
                # along the heading that is held, whatever the nose still has to turn to it
                return VelocityTarget((forward * math.cos(off), forward * math.sin(off), down), rate)

    def _stopping_s(self, time_us: int) -> float:
        """Return how far ahead of the vehicle, in seconds of its velocity, a hold is put.

        A move outlasts its time by up to a tick of the autopilot's telemetry, on some wires at every step. What was
        flown too far is taken back here, or those steps would all be too long.
        """
        late_us = 0 if self._moved_until_us is None else time_us - self._moved_until_us
        return STOPPING_S - (late_us / 1e6 if 0 < late_us <= LATE_MAX_US else 0.0)

    def _turned(self, yaw: float, time_us: int) -> float:
        """Return the heading to be held: where it was first wanted, and as far on as turns have asked for since.

        Not the heading that was reached: a vehicle lags behind a yaw rate by a third of a second, a real PX4 as ours,
        and a rotation of 60° would end at 40°.
        """
        if self._heading is None:
            self._heading = yaw
        self._turned_until(time_us)
        if not isinstance(self.setpoint, Turn):
            self._turn = None
        return self._heading

    def _turned_until(self, time_us: int | None) -> None:
        """Count what the present turn has turned by then. It ends when its time does, not at the tick that follows."""
        turn = self._turn
        if turn is None or time_us is None:
            return
        until_us = time_us if turn.ends_us is None else min(time_us, turn.ends_us)
        since_us = until_us if turn.counted_us is None else turn.counted_us
        if self._heading is not None:
            passed_us = max(0, min(until_us - since_us, TURN_GAP_US))
            self._heading = wrap_pi(self._heading + turn.yaw_rate * passed_us / 1e6)
        self._turn = Turning(turn.yaw_rate, until_us, turn.ends_us)

    def _height_correction(self, position: Vec3) -> float:
        assert self._height is not None
        return _clamped(HEIGHT_GAIN * (self._height - position[2]))

    def _place_correction(self, position: Vec3, yaw: float) -> tuple[float, float]:
        assert self._place is not None
        north, east = (self._place[i] - position[i] for i in (0, 1))
        forward = math.cos(yaw) * north + math.sin(yaw) * east
        right = -math.sin(yaw) * north + math.cos(yaw) * east
        return _clamped(PLACE_GAIN * forward), _clamped(PLACE_GAIN * right)


def message(target: Target, time_boot_ms: int, system: int, component: int) -> dialect.MAVLink_message:
    """Return SET_POSITION_TARGET_LOCAL_NED in the frames and masks that a real PX4 takes."""
    stamp = time_boot_ms % (1 << 32)
    match target:
        case VelocityTarget(velocity_body, yaw_rate):
            return dialect.MAVLink_set_position_target_local_ned_message(
                stamp,
                system,
                component,
                dialect.MAV_FRAME_BODY_NED,
                MASK_VELOCITY_YAW_RATE,
                0, 0, 0, *velocity_body, 0, 0, 0, 0, yaw_rate,
            )  # fmt: skip
        case PositionTarget(position_ned, yaw):
            return dialect.MAVLink_set_position_target_local_ned_message(
                stamp,
                system,
                component,
                dialect.MAV_FRAME_LOCAL_NED,
                MASK_POSITION_YAW,
                *position_ned, 0, 0, 0, 0, 0, 0, yaw, 0,
            )  # fmt: skip


def _clamped(speed: float) -> float:
    return max(-CORRECTION_MAX, min(CORRECTION_MAX, speed))
