"""How the logger relates a pose to the target: by the world's geometry where there is one."""

from collections.abc import Callable, Sequence
from typing import Protocol

from foundation.camera import CameraModel
from foundation.frames import Vec3
from foundation.truth import TruthSample


class TruthMeasurement(Protocol):
    """`episodes.world.world.Measurement` is one."""

    @property
    def target_ned(self) -> Vec3 | None: ...
    @property
    def distance_m(self) -> float | None: ...
    @property
    def distance_box_m(self) -> float | None: ...
    @property
    def visible(self) -> bool | None: ...
    @property
    def visible_fraction(self) -> float | None: ...
    @property
    def bearing_deg(self) -> float | None: ...
    @property
    def oracle_depth_m(self) -> float | None: ...
    @property
    def target_frd(self) -> Vec3 | None: ...
    @property
    def target_box(self) -> tuple[float, float, float, float] | None: ...


# (t in s, where the drone is, its camera, where the fleet's others are at that time)
Measure = Callable[[float, TruthSample, CameraModel, Sequence[TruthSample]], TruthMeasurement]
