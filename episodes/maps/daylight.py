"""Where the sun stands over a map."""

import math

from episodes.maps.scene import Sun


def sun_at(latitude_deg: float, day: int, solar_hour: float) -> Sun:
    """Return the sun over a latitude on a day of the year (1 … 365) at a true solar hour (12 = highest).

    Declination by Cooper's formula, the rest is spherical trigonometry.
    """
    declination = math.radians(23.45) * math.sin(2.0 * math.pi * (284 + day) / 365.0)
    latitude, hour = math.radians(latitude_deg), math.radians(15.0 * (solar_hour - 12.0))
    north = math.cos(latitude) * math.sin(declination) - math.sin(latitude) * math.cos(declination) * math.cos(hour)
    east = -math.cos(declination) * math.sin(hour)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    return Sun((north, east, -up))
