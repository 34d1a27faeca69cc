"""Detects resets of an autopilot's estimator in its ODOMETRY messages.

PX4 and the project's autopilot count all resets of the estimator in ODOMETRY.reset_counter (PX4: EKF2.cpp,
PublishOdometry). The counter does not say which quantity was reset, so this module computes how far each quantity
jumped. The jump is the new estimate minus a prediction from the previous estimate and the mean velocity and yaw rate of
both messages.
"""

import math
from dataclasses import dataclass

from foundation.frames import Vec3, quat_yaw, rotate, wrap_pi
from foundation.mavlink import Parser, dialect
from foundation.run_folder.rows import Reset, ResetQuantity
from foundation.wire import message_id

COUNTS = 256  # reset_counter is a uint8, so it wraps
# A quantity counts as reset if its jump exceeds LEAST_… plus the change that ACCELERATION or TURNING_DEG can cause
# between two messages. Measured flights accelerated by at most ACCELERATION, and changed the turn rate by at most
# TURNING_DEG within 0.2 s. For a reset with smaller jumps, `quantities` is empty.
LEAST_M, LEAST_MPS, LEAST_DEG = 0.2, 0.3, 3.0
ACCELERATION = 5.0  # m/s²
TURNING_DEG = 30.0  # °/s, change of the turn rate within 0.2 s


@dataclass(frozen=True, slots=True)
class _Odometry:
    time_us: int
    counter: int
    position_ned: Vec3
    velocity_ned: Vec3
    yaw: float  # rad
    yaw_rate: float  # rad/s, about the vertical


class ResetWatch:
    def __init__(self) -> None:
        self._parser = Parser()
        self._last: _Odometry | None = None

    @property
    def sends_counter(self) -> bool:
        """Whether the autopilot sends the counter: an ODOMETRY message has arrived."""
        return self._last is not None

    def frame(self, frame: bytes) -> Reset | None:
        """Process the bytes of one message; return the reset that it shows, or None."""
        if message_id(frame) != dialect.MAVLINK_MSG_ID_ODOMETRY:
            return None
        for message in self._parser.feed(frame):
            return self.message(message)
        return None

    def message(self, message: dialect.MAVLink_message) -> Reset | None:
        """Process an ODOMETRY message; return the reset that it shows, or None. Skips values that are not finite."""
        if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
            return None
        new, last = _odometry(message), self._last
        if last is not None and new.time_us <= last.time_us:
            return None
        if not all(map(math.isfinite, (*new.position_ned, *new.velocity_ned, new.yaw, new.yaw_rate))):
            return None
        self._last = new
        count = (new.counter - last.counter) % COUNTS if last else 0
        return _reset(last, new, count) if last and count else None


def _odometry(message: dialect.MAVLink_message) -> _Odometry:
    q = (message.q[0], message.q[1], message.q[2], message.q[3])
    velocity = (message.vx, message.vy, message.vz)
    if message.child_frame_id != dialect.MAV_FRAME_LOCAL_NED:  # child_frame_id is the frame of the velocity
        velocity = rotate(q, velocity)
    return _Odometry(
        time_us=message.time_usec,
        counter=message.reset_counter,
        position_ned=(message.x, message.y, message.z),
        velocity_ned=velocity,
        yaw=quat_yaw(q),
        yaw_rate=rotate(q, (message.rollspeed, message.pitchspeed, message.yawspeed))[2],
    )


def _reset(last: _Odometry, new: _Odometry, count: int) -> Reset:
    """Return the row of truth.jsonl for one or more resets between two messages, without its time and drone."""
    dt = (new.time_us - last.time_us) / 1e6
    turned = 0.5 * (last.yaw_rate + new.yaw_rate) * dt
    north, east, down = (
        b - a - 0.5 * (u + v) * dt
        for a, b, u, v in zip(last.position_ned, new.position_ned, last.velocity_ned, new.velocity_ned, strict=True)
    )
    yaw_deg = math.degrees(wrap_pi(new.yaw - last.yaw - turned))
    velocity_mps = math.dist(new.velocity_ned, last.velocity_ned)
    position_m = math.hypot(north, east)
    # a velocity reset shifts the predicted position; `velocity_mps` in the limit prevents a false position reset
    moved_m = LEAST_M + 0.5 * (ACCELERATION * dt + velocity_mps) * dt
    jumps: dict[ResetQuantity, bool] = {
        "yaw": abs(yaw_deg) > LEAST_DEG + TURNING_DEG * dt,
        "position": position_m > moved_m,
        "velocity": velocity_mps > LEAST_MPS + ACCELERATION * dt,
        "height": abs(down) > moved_m,
    }
    return Reset(
        t=0.0,
        drone=0,
        count=count,
        quantities=tuple(name for name, jumped in jumps.items() if jumped),
        yaw_deg=round(yaw_deg, 2),
        position_m=round(position_m, 2),
        height_m=round(-down, 2),
        velocity_mps=round(velocity_mps, 2),
    )
