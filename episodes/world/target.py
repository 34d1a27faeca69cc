"""Computes the pose of a target over time, on a path and with its wheels on uneven ground.

The motion is a pure function of the time since the episode began. A target on wheels pitches and rolls so that its
wheels touch the ground.
"""

import bisect
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Mesh
from episodes.records.record import TargetRecord
from foundation.frames import Quat, Vec3, course, quat_from_euler, rotate, vec3
from foundation.terrain import HeightField

# Distance (m) between the two points of the path that define the heading: the wheelbase of a vehicle, or about one step
# of a walker.
HEADING_BASE_M = {
    "bus": 6.0, "pickup": 3.35, "van": 3.1, "suv": 2.75, "sedan": 2.75, "estate": 2.75, "hatchback": 2.55,
    "service_cart": 1.7, "motorcycle": 1.4, "cyclist": 1.05, "delivery_robot": 0.45,
    "person": 0.6, "pedestrian": 0.6,
}  # fmt: skip
AXLES_OF_OTHERS_M = 1.0  # the same distance for all other assets
WALKERS = ("person", "pedestrian")  # they stay upright on a slope; all others in HEADING_BASE_M have wheels

TOUCHES_M = 0.01  # m, height of the part of a wheel that counts as touching the ground
ONE_TRACK_M = 0.3  # m; a vehicle with a narrower track counts as single-track, like a motorcycle, and does not roll
LEVEL_RAD = 1e-6  # smaller slopes are rounding errors
TURNS = 3  # iterations of `Wheels.on`; another iteration would change the position by less than 0.1 mm


@dataclass(frozen=True, slots=True)
class TargetMotion:
    """The motion of a target. A standing target has one waypoint and speed 0."""

    waypoints_ned: tuple[Vec3, ...]  # m
    reached_m: tuple[float, ...]  # m along the path at each waypoint, measured in three dimensions
    speed_mps: float
    yaw: float  # rad, for a standing target only
    axles_m: float  # m between the two points of the path that define the heading

    @property
    def length_m(self) -> float:
        """Return the length (m) of the path; 0 for a standing target."""
        return self.reached_m[-1]

    def pose(self, t_s: float) -> tuple[Vec3, float]:
        """Return (position_ned of the asset's origin in m, yaw in rad) at time t_s ≥ 0; earlier times count as 0.

        The target follows the path once and stays at its end. Its heading is the direction between two points of the
        path: half of `axles_m` behind the target and half of `axles_m` ahead. So it turns gradually at a corner.
        """
        if self.speed_mps == 0.0:
            return self.waypoints_ned[0], self.yaw
        s = min(max(t_s, 0.0) * self.speed_mps, self.reached_m[-1])
        rear, front = self._at(s - self.axles_m / 2), self._at(s + self.axles_m / 2)
        return self._at(s), course(rear, front)

    def _at(self, s: float) -> Vec3:
        """Return the point at arc length s; the first and last legs are extended beyond the ends."""
        k = min(max(bisect.bisect_right(self.reached_m, s) - 1, 0), len(self.reached_m) - 2)
        a, b = self.waypoints_ned[k], self.waypoints_ned[k + 1]
        u = (s - self.reached_m[k]) / (self.reached_m[k + 1] - self.reached_m[k])
        return on_line(a, b, u)


def on_line(a: Vec3, b: Vec3, u: float) -> Vec3:
    """Return the point on the line through a (u = 0) and b (u = 1)."""
    return (a[0] + u * (b[0] - a[0]), a[1] + u * (b[1] - a[1]), a[2] + u * (b[2] - a[2]))


def has_wheels(asset: str) -> bool:
    """Return whether a moving asset has wheels."""
    return asset in HEADING_BASE_M and asset not in WALKERS


def motion(target: TargetRecord) -> TargetMotion:
    """Return the motion that a target's record defines."""
    if target.path is None:
        if target.position_ned is None or target.yaw_deg is None:
            raise ValueError("a target has either a pose or a path")
        return TargetMotion((target.position_ned,), (0.0,), 0.0, math.radians(target.yaw_deg), 0.0)
    points = target.path.waypoints_ned
    reached = [0.0]
    for a, b in itertools.pairwise(points):
        reached.append(reached[-1] + math.dist(a, b))
    return TargetMotion(
        points, tuple(reached), target.path.speed_mps, 0.0, HEADING_BASE_M.get(target.asset, AXLES_OF_OTHERS_M)
    )


def contact_patch(mesh: Mesh) -> NDArray[np.float64]:
    """Return the points (N, 3) of a mesh, m in its own axes, that touch level ground under it."""
    points = mesh.vertices.astype(np.float64)
    low: NDArray[np.float64] = points[points[:, 2] >= points[:, 2].max() - TOUCHES_M]
    return low


@dataclass(frozen=True, slots=True)
class Wheels:
    """The places of an asset's wheels in its own axes, and the middle of its box."""

    ahead_m: tuple[float, float]  # x of the rear and of the front wheels
    aside_m: tuple[float, float]  # y of the left and of the right wheels; both 0 for a single-track vehicle
    middle_frd: Vec3  # m, of the asset's bounding box

    @classmethod
    def if_any(cls, asset: str, mesh: Mesh) -> "Wheels | None":
        """Return the wheels of an asset, which are at the corners of its contact patch; None if it has none."""
        if not has_wheels(asset):
            return None
        low = contact_patch(mesh)
        box = (mesh.vertices.min(axis=0).astype(np.float64) + mesh.vertices.max(axis=0).astype(np.float64)) / 2
        left, right = float(low[:, 1].min()), float(low[:, 1].max())
        return cls(
            (float(low[:, 0].min()), float(low[:, 0].max())),
            (left, right) if right - left >= ONE_TRACK_M else (0.0, 0.0),
            vec3(box),
        )

    def on(self, ground: HeightField, level_ned: Vec3, yaw: float) -> tuple[Vec3, float | Quat]:
        """Return the pose (m NED, attitude FRD → NED) in which the wheels touch the ground.

        `level_ned` is the origin of the asset in its level pose. The result keeps the north and east
        coordinates of the middle of the asset's box. On level ground, the result is (`level_ned`, `yaw`).
        """
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, _ = self.middle_frd
        north, east = level_ned[0] + c * x - s * y, level_ned[1] + s * x + c * y  # of the middle
        place, turned = level_ned, quat_from_euler(0.0, 0.0, yaw)
        for _ in range(TURNS):
            ahead, aside, down = self._plane(ground, place, yaw)
            if abs(ahead) < LEVEL_RAD and abs(aside) < LEVEL_RAD:
                return level_ned, yaw
            pitch = -math.atan(ahead)
            turned = quat_from_euler(math.atan(aside * math.cos(pitch)), pitch, yaw)
            arm = rotate(turned, self.middle_frd)
            further = north - arm[0] - place[0], east - arm[1] - place[1]
            down += ahead * (c * further[0] + s * further[1]) + aside * (c * further[1] - s * further[0])
            place = (north - arm[0], east - arm[1], down)
        return place, turned

    def _plane(self, ground: HeightField, place: Vec3, yaw: float) -> tuple[float, float, float]:
        """Return the plane under the wheels: its slopes ahead and aside (m/m), and its NED z (m) at `place`."""
        c, s = math.cos(yaw), math.sin(yaw)
        feet = [
            (x, y, ground.at(place[0] + c * x - s * y, place[1] + s * x + c * y))
            for x, y in itertools.product(self.ahead_m, self.aside_m)
        ]
        long, wide = self.ahead_m[1] - self.ahead_m[0], self.aside_m[1] - self.aside_m[0]
        rear, front = (feet[0][2] + feet[1][2]) / 2, (feet[2][2] + feet[3][2]) / 2
        left, right = (feet[0][2] + feet[2][2]) / 2, (feet[1][2] + feet[3][2]) / 2
        ahead, aside = (front - rear) / long, (right - left) / wide if wide else 0.0
        middle = (sum(self.ahead_m) / 2, sum(self.aside_m) / 2)
        return ahead, aside, (rear + front) / 2 - ahead * middle[0] - aside * middle[1]


def on_ground(wheels: Wheels | None, ground: HeightField, pose: tuple[Vec3, float]) -> tuple[Vec3, float | Quat]:
    """Return the pose of an asset with its wheels on the ground. Without `wheels`, return `pose`, the level pose."""
    return pose if wheels is None else wheels.on(ground, *pose)
