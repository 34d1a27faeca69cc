"""How a thing on wheels stands on uneven ground: pitched and rolled so that its wheels touch it."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from episodes.maps.scene import Mesh
from episodes.world.target import has_wheels
from foundation.frames import Quat, Vec3, quat_from_euler, rotate
from foundation.terrain import HeightField

TOUCHES_M = 0.01  # above its lowest point, what belongs to the part of a wheel that touches the ground
ONE_TRACK_M = 0.3  # wheels that are nearer to one another across are in line: what they carry does not roll
LEVEL_RAD = 1e-6  # a slope below it is rounding
TURNS = 3  # by then the place has moved by less than 0.1 mm


def contact_patch(mesh: Mesh) -> NDArray[np.float64]:
    """Return the points (N, 3) of a mesh, m in its own axes, that touch level ground under it."""
    points = mesh.vertices.astype(np.float64)
    low: NDArray[np.float64] = points[points[:, 2] >= points[:, 2].max() - TOUCHES_M]
    return low


@dataclass(frozen=True, slots=True)
class Wheels:
    """Where the wheels of a thing stand, in its own axes, and how high the middle of its box is."""

    ahead_m: tuple[float, float]  # of the rear and of the front ones
    aside_m: tuple[float, float]  # of the left and of the right ones; both 0 where they are in line
    middle_frd: Vec3  # m, of the box around it

    @classmethod
    def of(cls, mesh: Mesh) -> "Wheels":
        """Return those of a mesh: the corners of what touches the ground."""
        low = contact_patch(mesh)
        box = (mesh.vertices.min(axis=0).astype(np.float64) + mesh.vertices.max(axis=0).astype(np.float64)) / 2
        left, right = float(low[:, 1].min()), float(low[:, 1].max())
        return cls(
            (float(low[:, 0].min()), float(low[:, 0].max())),
            (left, right) if right - left >= ONE_TRACK_M else (0.0, 0.0),
            (float(box[0]), float(box[1]), float(box[2])),
        )

    def on(self, ground: HeightField, level_ned: Vec3, yaw: float) -> tuple[Vec3, float | Quat]:
        """Return the pose (m NED, attitude FRD → NED) in which they touch the ground.

        `level_ned` is where the thing's origin would be if it were level: the middle of its box stays straight above or
        below where it would be then. Level ground gives back the pose it was asked for, with its yaw.
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

    @classmethod
    def if_any(cls, asset: str, mesh: Mesh) -> "Wheels | None":
        """Return the wheels of an asset, None for one that stands on feet or on its base."""
        return cls.of(mesh) if has_wheels(asset) else None

    def _plane(self, ground: HeightField, place: Vec3, yaw: float) -> tuple[float, float, float]:
        """Return the plane under the wheels: its slopes ahead and aside, and its NED z (m) at a place."""
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
    """Return the pose of a thing, with its wheels on the ground if it has any; `pose` is the one if it stood level."""
    return pose if wheels is None else wheels.on(ground, *pose)
