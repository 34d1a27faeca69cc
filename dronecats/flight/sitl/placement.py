"""A vehicle that simulates itself somewhere else, moved onto our map: where it stood becomes the start's ground.

Only what is drawn and measured is moved. The vehicle flies where it is, over the ground of its own simulation.
"""

import math
from dataclasses import dataclass

from foundation.frames import Vec3, geodetic_to_ned, quat_from_euler, quat_multiply, quat_yaw, rotate, wrap_pi
from foundation.mavlink import dialect
from foundation.truth import Origin, TruthSample, truth_sample


@dataclass(frozen=True, slots=True)
class Placement:
    """A shift and a turn about the vertical, from where a vehicle is to where it is on the map."""

    home: Origin  # lat °, lon °, alt m of where it stood
    place_ned: Vec3  # m, map frame, of where it stands there
    turn: float  # rad, from its heading to the map's, positive towards east

    def sample(self, message: dialect.MAVLink_message, time_us: int, drone: int = 0) -> TruthSample:
        """Return where on the map a HIL_STATE_QUATERNION says that the vehicle is."""
        there = truth_sample(message, self.home)
        turned = quat_from_euler(0.0, 0.0, self.turn)
        return TruthSample(
            drone,
            time_us,
            self._moved(there.position_ned),
            rotate(turned, there.velocity_ned),
            quat_multiply(turned, there.attitude),
        )

    def on_map(self, place: Origin) -> Vec3:
        """Return the place on the map (m, NED) of a place where the vehicle is (lat °, lon °, alt m)."""
        return self._moved(geodetic_to_ned(*self.home, *place))

    def _moved(self, position_ned: Vec3) -> Vec3:
        north, east, down = rotate(quat_from_euler(0.0, 0.0, self.turn), position_ned)
        return (self.place_ned[0] + north, self.place_ned[1] + east, self.place_ned[2] + down)


def standing(message: dialect.MAVLink_message, place_ned: Vec3, yaw: float) -> Placement:
    """Return the placement that puts a vehicle which says this onto `place_ned` (m) with a heading of `yaw` (rad)."""
    home = (message.lat / 1e7, message.lon / 1e7, message.alt / 1e3)
    return Placement(home, place_ned, wrap_pi(yaw - own_yaw(message)))


def own_yaw(message: dialect.MAVLink_message) -> float:
    """Return the heading (rad) that a HIL_STATE_QUATERNION says."""
    return quat_yaw(tuple(message.attitude_quaternion))


def speed(message: dialect.MAVLink_message) -> float:
    """Return the speed (m/s) that a HIL_STATE_QUATERNION says."""
    return math.hypot(message.vx, message.vy, message.vz) / 100.0


class TruthClock:
    """The vehicle's time of each truth sample, in whole milliseconds: what a frame's announcement can carry.

    PX4's own simulation leaves the time of HIL_STATE_QUATERNION at zero. HIL_ACTUATOR_CONTROLS, which comes beside it
    a hundred times a second and more, has it.
    """

    def __init__(self) -> None:
        self._heard_us = 0

    def see(self, message: dialect.MAVLink_message) -> int | None:
        """Return the time (µs) of a truth sample; None of any other message, and as long as no time is known."""
        kind = message.get_msgId()
        if kind == dialect.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
            self._heard_us = message.time_usec
        if kind != dialect.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
            return None
        time_us = message.time_usec or self._heard_us
        return time_us // 1000 * 1000 or None
