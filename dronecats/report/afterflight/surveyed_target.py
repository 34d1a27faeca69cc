"""A target whose place was surveyed by satellite, and how far a pose is from it, give or take."""

import math
from dataclasses import asdict, dataclass, fields
from typing import Any

from foundation.errors import UsageError
from foundation.frames import Vec3, geodetic_to_ned

HANDHELD_STD_M = 3.0  # m, what a telephone or a handheld receiver does in the open; RTK does 0.02


@dataclass(frozen=True, slots=True)
class SurveyedTarget:
    """The centre of the target."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float | None  # m above mean sea level; None: not surveyed, so that distances are horizontal
    std_m: float = HANDHELD_STD_M  # m, per axis

    def as_json(self) -> dict[str, Any]:
        """Return it as it stands in files."""
        return asdict(self)

    def ned(self, origin: Vec3) -> Vec3:
        """Return its place in the local frame of `origin` (lat °, lon °, alt m); at the origin's height if unknown."""
        altitude = origin[2] if self.altitude_m is None else self.altitude_m
        return geodetic_to_ned(*origin, self.latitude_deg, self.longitude_deg, altitude)

    def distance(self, target_ned: Vec3, position_ned: Vec3, std_ned: Vec3) -> tuple[float, float]:
        """Return (distance, its standard deviation) in m; the second is NaN where that of the pose is not known."""
        axes = range(2 if self.altitude_m is None else 3)
        apart = [position_ned[i] - target_ned[i] for i in axes]
        variances = [std_ned[i] ** 2 + self.std_m**2 for i in axes]
        distance = math.hypot(*apart)
        if distance * distance <= max(variances):  # nearer than what is known: no direction to project on
            return distance, math.sqrt(max(variances))
        return distance, math.sqrt(sum(v * (a / distance) ** 2 for v, a in zip(variances, apart, strict=True)))


def target_from(text: str, std_m: float | None = None) -> SurveyedTarget:
    """Return the target that `LAT,LON` or `LAT,LON,ALT` names. Raises UsageError."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(math.isfinite(n) for n in numbers):
        raise UsageError(f"a target is LAT,LON or LAT,LON,ALT, for example 47.397742,8.545594,488.2; got '{text}'")
    latitude, longitude, *altitude = numbers
    return checked(latitude, longitude, altitude[0] if altitude else None, HANDHELD_STD_M if std_m is None else std_m)


def target_of(value: Any) -> SurveyedTarget:
    """Return the target that `as_json` wrote. Raises UsageError for anything else."""
    if isinstance(value, dict):
        given: list[Any] = [value.get(f.name) for f in fields(SurveyedTarget)]
        latitude, longitude, altitude, std_m = given
        if all(_is_number(v) for v in (latitude, longitude, std_m)) and (altitude is None or _is_number(altitude)):
            return checked(latitude, longitude, altitude, std_m)
    raise UsageError("a surveyed target wants latitude_deg, longitude_deg, altitude_m (or null) and std_m, in numbers")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def checked(latitude: float, longitude: float, altitude: float | None, std_m: float) -> SurveyedTarget:
    """Return the target. Raises UsageError when it is nowhere on Earth or its accuracy is none."""
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and (altitude is None or -500.0 <= altitude <= 9000.0)):
        raise UsageError(f"a target at latitude {latitude:g}, longitude {longitude:g}, altitude {altitude} is nowhere")
    if not 0.0 <= std_m <= 100.0:
        raise UsageError(f"a target is surveyed to 0 to 100 m, got {std_m:g}")
    return SurveyedTarget(latitude, longitude, altitude, std_m)
