"""What a pilot that knows the truth knows of one drone."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from foundation.camera import CameraModel
from foundation.frames import Quat, Vec3, wrap_pi


@dataclass(frozen=True, slots=True)
class TrueSight:
    """A drone and its target, as they are."""

    position_ned: Vec3  # m, body origin
    yaw_rad: float  # from north, + east
    attitude: Quat  # of the body
    target_ned: Vec3  # m, centre
    target_velocity_ned: Vec3  # m/s
    camera: CameraModel
    drone: int = 0  # which one this is
    step: int = 0  # of its questions, from 0
    visible: bool = True  # whether the picture shows the target; True of what is not looked at

    @property
    def distance_m(self) -> float:
        """Return the distance, m, body origin to target centre in three dimensions, as the verifier measures it."""
        return math.dist(self.position_ned, self.target_ned)

    @property
    def bearing_deg(self) -> float:
        """Return where the target is, degrees from the nose, + right."""
        north, east = (self.target_ned[k] - self.position_ned[k] for k in (0, 1))
        return math.degrees(wrap_pi(math.atan2(east, north) - self.yaw_rad))


Knowing = Callable[[Sequence[TrueSight]], str]  # what is true of each drone that is asked for -> the reply
