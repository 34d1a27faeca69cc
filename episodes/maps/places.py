"""What a map offers to whoever writes records: free ground, ways for moving targets, things to refer to."""

import math
from dataclasses import dataclass
from itertools import pairwise

from foundation.frames import Vec3


@dataclass(frozen=True, slots=True)
class Spot:
    """A free place on the ground where a target or a look-alike may stand."""

    position_ned: Vec3  # m, on the ground
    yaw: float  # rad, the way a thing put there naturally faces
    place: str  # what the ground is: 'kerb', 'drive', 'plaza', 'path', 'lawn' …


@dataclass(frozen=True, slots=True)
class Lane:
    """A way along which a target may move from its first waypoint to its last."""

    name: str
    waypoints_ned: tuple[Vec3, ...]  # m, on the ground, near enough to follow it between them
    width_m: float  # free of everything solid, half of it on either side

    @property
    def length_m(self) -> float:
        """Return the length (m) along the waypoints."""
        return sum(math.dist(a, b) for a, b in pairwise(self.waypoints_ned))


@dataclass(frozen=True, slots=True)
class Landmark:
    """A thing of the map by which others may be told apart."""

    name: str  # of the instance
    phrase: str  # what a person calls it, article included; true of no other instance of the map


@dataclass(frozen=True, slots=True)
class Places:
    """Everything of this kind that a map has."""

    spots: tuple[Spot, ...]
    lanes: tuple[Lane, ...]
    landmarks: tuple[Landmark, ...] = ()
