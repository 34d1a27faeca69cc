"""How the logger relates a pose to the target: by the world's geometry where there is one."""

from collections.abc import Callable
from typing import Protocol

from dronecats.border.camera import CameraModel
from dronecats.border.frames import Vec3
from dronecats.border.truth import TruthSample


class Measured(Protocol):
    """`episodes.world.Measurement` is one."""

    target_ned: Vec3 | None
    distance_m: float | None
    distance_box_m: float | None
    visible: bool | None
    visible_fraction: float | None
    bearing_deg: float | None
    oracle_depth_m: float | None


Measure = Callable[[float, TruthSample, CameraModel], Measured]  # (t in s, where the drone is, its camera)
