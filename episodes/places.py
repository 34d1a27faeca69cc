"""Where a map has room for what an episode adds to it: spots to stand on and lanes to move along."""

import itertools
import math
from dataclasses import dataclass

from dronecats.border.frames import Vec3


@dataclass(frozen=True, slots=True)
class Spot:
    """A free rectangle of ground on which a target may stand."""

    kind: str  # what a person would call the place: 'kerb', 'drive', 'lawn', 'pavement' …
    position_ned: Vec3  # m, its middle, on the ground
    yaw: float  # rad, how a thing stands here: along the kerb with the traffic, nose to the garage …
    length_m: float  # free along the yaw
    width_m: float  # free across it


@dataclass(frozen=True, slots=True)
class Lane:
    """A one-way route on the ground with nothing in the way; a path may follow all of it or any stretch of it."""

    kind: str  # who moves here: 'road' (vehicles and cyclists), 'drive' (a road reached from a drive), 'pavement' …
    waypoints_ned: tuple[Vec3, ...]  # m; between two of them the ground is within 2 cm of the straight line
    width_m: float  # what moves here must be narrower

    @property
    def length_m(self) -> float:
        """Return the length of the route in three dimensions (m)."""
        return sum(math.dist(a, b) for a, b in itertools.pairwise(self.waypoints_ned))


@dataclass(frozen=True, slots=True)
class Places:
    """All the room of one map, in an order that its seed decides."""

    spots: tuple[Spot, ...]
    lanes: tuple[Lane, ...]
