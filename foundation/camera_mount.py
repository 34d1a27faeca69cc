"""The mount of a vehicle's camera, in its airframe's file."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

PitchDeg = Annotated[float, Meta(ge=-90.0, le=90.0)]


@dataclass(frozen=True, slots=True)
class GimbalLimits:
    """A gimbal with a pitch axis, which holds the camera level in roll."""

    pitch_min_deg: PitchDeg = -90.0  # up from the horizon
    pitch_max_deg: PitchDeg = 30.0
    rate_deg_s: Annotated[float, Meta(gt=0.0, le=1000.0)] = 60.0


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Mount of the forward camera."""

    pitch_deg: PitchDeg = 0.0  # up from body forward, on a gimbal from the horizon; the benchmark's camera looks level
    gimbal: GimbalLimits | None = None  # None: it is fixed to the body


LEVEL = CameraMount()
