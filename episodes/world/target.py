"""Where a target is: a pure function of the time since the episode began."""

import bisect
import itertools
import math
from dataclasses import dataclass

from episodes.records.record import TargetRecord
from foundation.frames import Vec3

# Distance (m) between the two points of the path that the heading is drawn through: a vehicle's wheelbase, and about
# a step of what walks.
AXLES_M = {
    "bus": 6.0, "pickup": 3.35, "van": 3.1, "suv": 2.75, "sedan": 2.75, "hatchback": 2.55,
    "service_cart": 1.7, "motorcycle": 1.4, "cyclist": 1.05, "delivery_robot": 0.45,
    "person": 0.6, "pedestrian": 0.6,
}  # fmt: skip
AXLES_OF_OTHERS_M = 1.0
WALKERS = ("person", "pedestrian")  # who stay upright on a slope; all others of these stand on wheels


@dataclass(frozen=True, slots=True)
class TargetMotion:
    """A target's whole movement. A standing target has one waypoint and speed 0."""

    waypoints_ned: tuple[Vec3, ...]  # m
    reached_m: tuple[float, ...]  # m along the path at each waypoint, measured in three dimensions
    speed_mps: float
    yaw: float  # rad, of a standing target
    axles_m: float  # between the two points of the path that the heading is drawn through

    @property
    def length_m(self) -> float:
        """Return how long the path is; 0 of a standing target."""
        return self.reached_m[-1]

    def pose(self, t_s: float) -> tuple[Vec3, float]:
        """Return (position_ned of the asset's origin in m, yaw in rad in [-π, π]) at time t_s; before 0 as at 0.

        The path is followed once and the target stays at its end. The heading joins two points of the path half a
        wheelbase (of a walker: half a step) ahead and behind, so it turns into a corner gradually, as each would.
        """
        if self.speed_mps == 0.0:
            return self.waypoints_ned[0], self.yaw
        s = min(max(t_s, 0.0) * self.speed_mps, self.reached_m[-1])
        rear, front = self._at(s - self.axles_m / 2), self._at(s + self.axles_m / 2)
        return self._at(s), math.atan2(front[1] - rear[1], front[0] - rear[0])

    def _at(self, s: float) -> Vec3:
        """Return the point at arc length s; the first and last legs go on beyond the ends."""
        k = min(max(bisect.bisect_right(self.reached_m, s) - 1, 0), len(self.reached_m) - 2)
        a, b = self.waypoints_ned[k], self.waypoints_ned[k + 1]
        u = (s - self.reached_m[k]) / (self.reached_m[k + 1] - self.reached_m[k])
        return (a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1]), a[2] + u * (b[2] - a[2]))


def has_wheels(asset: str) -> bool:
    """Return whether what moves stands on wheels."""
    return asset in AXLES_M and asset not in WALKERS


def motion(target: TargetRecord) -> TargetMotion:
    """Return the movement that a record asks for."""
    if target.path is None:
        if target.position_ned is None or target.yaw_deg is None:
            raise ValueError("a target has either a pose or a path")
        return TargetMotion((target.position_ned,), (0.0,), 0.0, math.radians(target.yaw_deg), 0.0)
    points = target.path.waypoints_ned
    reached = [0.0]
    for a, b in itertools.pairwise(points):
        reached.append(reached[-1] + math.dist(a, b))
    return TargetMotion(
        points, tuple(reached), target.path.speed_mps, 0.0, AXLES_M.get(target.asset, AXLES_OF_OTHERS_M)
    )
