"""Light and season of a flight. `episodes.maps.conditions` applies them to a map."""

from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from foundation.conversion import convert

LOWEST_DEG = 3.0  # lowest allowed elevation of the sun; with a lower sun, shadows reach across the whole map


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConditions:
    """Light and season. A field that is None keeps the value of the map."""

    sun_azimuth_deg: float | None = None  # clockwise from north
    sun_elevation_deg: float | None = None  # above the horizon, LOWEST_DEG … 90
    sky: Literal["overcast", "dusk"] | None = None
    season: Literal["autumn"] | None = None


AS_BUILT = SceneConditions()


def recorded(flight: Any) -> SceneConditions:
    """Return the conditions in the flight object of a run.json; AS_BUILT if they are missing or invalid."""
    try:
        return convert(flight["disturbances"]["conditions"], SceneConditions)
    except (KeyError, TypeError, msgspec.ValidationError):
        return AS_BUILT
