"""The camera mount of a vehicle, as its airframe file declares it."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

PitchDeg = Annotated[float, Meta(ge=-90.0, le=90.0)]


@dataclass(frozen=True, slots=True)
class GimbalLimits:
    """Limits of a gimbal, which changes the camera's pitch and keeps the camera level in roll."""

    pitch_min_deg: PitchDeg = -90.0  # up from the horizon
    pitch_max_deg: PitchDeg = 30.0  # up from the horizon
    rate_deg_s: Annotated[float, Meta(gt=0.0, le=1000.0)] = 60.0


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Mount of the forward camera."""

    pitch_deg: PitchDeg = 0.0  # up from body forward; with a gimbal, up from the horizon; 0 in the benchmark
    gimbal: GimbalLimits | None = None  # None: the camera is fixed to the body


LEVEL = CameraMount()
